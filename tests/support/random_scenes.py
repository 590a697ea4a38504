"""Random scenes of every kind that a rasterizer is asked to draw, for hypothesis."""

from dataclasses import dataclass, replace

import torch
from hypothesis import strategies as st
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats
from support.scenes import random_splats

SIZES = ((1, 1), (17, 31), (1, 300), (300, 1), (64, 64), (16, 16), (33, 9))
CHANNELS = (1, 3, 4, 5, 16, 33)


@dataclass(frozen=True)
class Kind:
    """What a scene is made of."""

    seed: int
    size: tuple[int, int]
    model: CameraModel
    count: int = 25
    cameras: int = 1
    degree: int = 3
    layout: str = "together"
    """Of colours: together, two parts, ragged, half active, or channels."""
    channels: int = 3
    extras: int = 0
    covariances: bool = False
    background: str = "none"
    """none, constant, or differentiated."""
    antialias: bool = False
    depth: Depth = Depth.NONE
    cut_offs: bool = True

    def scene(self, dtype: torch.dtype) -> tuple[Splats, Cameras, RenderSettings]:
        """The scene in float32's numbers, whatever the type."""
        generator = torch.Generator().manual_seed(self.seed)
        background = None
        if self.background != "none":
            background = torch.rand(self._drawn_channels(), generator=generator).to(dtype)
            background.requires_grad_(self.background == "differentiated")
        settings = RenderSettings(
            background=background,
            antialias=self.antialias,
            depth=self.depth,
            statistics=frozenset(Statistic),
            profile=DEFAULT if self.cut_offs else DEFAULT.without_cutoffs(),
        )
        splats = self._splats(generator).map(lambda tensor: tensor.to(dtype))
        return splats, self._cameras(generator).to(dtype=dtype), settings

    def _drawn_channels(self) -> int:
        return self.channels if self.layout == "channels" else 3

    def _splats(self, generator: torch.Generator) -> Splats:
        n = self.count
        splats = random_splats(n, self.degree, self.seed)
        if self.covariances:
            axes = (
                0.2
                * torch.randn(n, 3, 3, generator=generator)
                / (1 + torch.rand(n, 1, 1, generator=generator))
            )
            made = (axes.double() @ axes.double().transpose(1, 2)).float()
            splats = replace(splats, quats=None, scales=None, covariances=made)
        if self.extras:
            splats = replace(splats, extra=torch.randn(n, self.extras, generator=generator))
        return replace(splats, colors=self._colors(splats.colors, generator))

    def _colors(self, colors: Sh | Tensor, generator: torch.Generator) -> Sh | Tensor:
        assert isinstance(colors, Sh)
        held = colors.coefficients
        if self.layout == "channels":
            return torch.rand(self.count, self.channels, generator=generator)
        if self.layout == "two parts":
            return Sh(held[:, :1].clone(), self.degree, rest=held[:, 1:].clone())
        if self.layout == "half active":
            return Sh(held, self.degree // 2)
        if self.layout == "ragged":
            degrees = torch.randint(self.degree + 1, (self.count,), generator=generator)
            return colors.of_degrees(degrees)
        return colors

    def _cameras(self, generator: torch.Generator) -> Cameras:
        width, height = self.size
        views = torch.eye(4, dtype=torch.float64).repeat(self.cameras, 1, 1)
        turn = 0.4 * torch.randn(self.cameras, 3, 3, generator=generator, dtype=torch.float64)
        views[:, :3, :3] = torch.linalg.matrix_exp(turn - turn.transpose(1, 2))
        views[:, :3, 3] = 0.2 * torch.randn(self.cameras, 3, generator=generator).double()
        views[:, 2, 3] += 3.5
        focal = 0.9 * max(width, height) / (3 if self.model is CameraModel.ORTHOGRAPHIC else 1)
        k = torch.tensor([[focal, 0, 0.45 * width], [0, 1.1 * focal, 0.6 * height], [0, 0, 1]])
        intrinsics = k.double().repeat(self.cameras, 1, 1)
        return Cameras(views.float(), intrinsics.float(), width, height, self.model)


def kinds(**fixed: object) -> st.SearchStrategy[Kind]:
    """Kinds of scenes, some of whose properties are given."""
    free: dict[str, st.SearchStrategy] = {
        "seed": st.integers(0, 2**31),
        "size": st.sampled_from(SIZES),
        "model": st.sampled_from(CameraModel),
        "count": st.integers(8, 40),
        "cameras": st.integers(1, 3),
        "degree": st.integers(0, 4),
        "layout": st.sampled_from(["together", "two parts", "ragged", "half active", "channels"]),
        "channels": st.sampled_from(CHANNELS),
        "extras": st.sampled_from([0, 0, 1, 3]),
        "covariances": st.booleans(),
        "background": st.sampled_from(["none", "constant", "differentiated"]),
        "antialias": st.booleans(),
        "depth": st.sampled_from(Depth),
        "cut_offs": st.booleans(),
    }
    return st.builds(Kind, **(free | {name: st.just(value) for name, value in fixed.items()}))
