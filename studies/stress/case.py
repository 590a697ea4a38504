"""StressCase: one extreme with its expectations, and the small scenes of the cases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Feature, Needs
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats


class Section(Enum):
    """A part of the catalogue; the first word of its cases' names."""

    SHAPE = "shape"
    ROTATION = "rotation"
    OPACITY = "opacity"
    DEPTH = "depth"
    POSITION = "position"
    CAMERA = "camera"
    IMAGE = "image"
    LAYERS = "layers"
    COLOUR = "colour"
    INPUT = "input"
    SIZE = "size"
    TIME = "time"
    PRECISION = "precision"
    FOUND = "found"
    """Worst cases of a search."""


GRADIENTS = frozenset({Feature.GRADIENT, Feature.POSE_GRADIENT})
"""Gradients that a backend can compute."""


@dataclass(frozen=True)
class Drawing:
    """Input of a rasterizer."""

    splats: Splats
    cameras: Cameras
    settings: RenderSettings
    gradients: frozenset[Feature] = GRADIENTS
    """Gradients to compare: of splats and background, and of poses."""

    def double(self) -> Drawing:
        """The same input, to the last bit, in float64."""
        background = self.settings.background
        if background is not None:
            wanted = background.requires_grad
            background = background.detach().double().requires_grad_(wanted)
        return Drawing(
            self.splats.map(lambda tensor: tensor.double()),
            self.cameras.to(dtype=torch.float64),
            replace(self.settings, background=background),
            self.gradients,
        )

    def to(self, device: torch.device) -> Drawing:
        """The same input on another device."""
        background = self.settings.background
        if background is not None:
            background = background.detach().to(device).requires_grad_(background.requires_grad)
        return Drawing(
            self.splats.to(device),
            self.cameras.to(device=device),
            replace(self.settings, background=background),
            self.gradients,
        )

    def needs(self) -> Needs:
        """Needs of this input."""
        splats, colors = self.splats, self.splats.colors
        asked = {
            **{feature: feature in self.gradients for feature in GRADIENTS},
            Feature.SH: isinstance(colors, Sh),
            Feature.RAGGED_SH: isinstance(colors, Sh) and colors.offsets is not None,
            Feature.COVARIANCES: splats.covariances is not None,
            Feature.EXTRA: splats.extra is not None,
            Feature.FLOAT64: splats.means.dtype == torch.float64,
        }
        features = frozenset(feature for feature, needed in asked.items() if needed)
        models = frozenset({self.cameras.model})
        return Needs(models, features, splats.channels) | self.settings.needs()


@dataclass(frozen=True)
class StressCase:
    """One extreme."""

    name: str
    """Section, extreme property and way of rendering: ``shape/needles/fisheye``."""
    make: Callable[[], Drawing]
    """Makes the input, in the numbers of float32; the same at every call."""
    truth: Callable[[], Drawing] | None = None
    """Makes the input of the expected image in float64, where it differs from ``make``, for example
    before rounding. Images are compared with it, and no gradients."""
    conditioning: str = ""
    """The reason why float32 misses the ordinary tolerances; it must then be no worse than the
    reference in float32. Empty: the ordinary tolerances hold."""
    about: frozenset[Feature] = frozenset()
    """Features that the case is about, besides the form of its splats: a backend without one is not
    judged by it. It can do without all others, such as antialiasing."""
    at_a_cut_off: int = 0
    """Number of splats on a cut-off, where any rounding decides whether they show: pixels may
    differ by as many flips, and gradients are not compared."""
    bound: float = 1e-5
    """With ``truth``: largest distance of the image from it, in relative L2."""
    refusal: tuple[str, ...] = ()
    """Parts of the message of the expected refusal; empty: the case must be rendered."""
    refused_number: int = 0
    """The message must hold a number of at least this, for example of a count that has not
    overflowed; 0: any message does."""

    @property
    def section(self) -> Section:
        """Section of the catalogue."""
        return Section(self.name.partition("/")[0])


Change = Callable[[Splats], Splats]
"""Makes ordinary splats extreme."""


def coefficients(splats: Splats) -> Tensor:
    """SH coefficients of splats.

    Raises:
        TypeError: their colours are plain channels.
    """
    if not isinstance(splats.colors, Sh):
        raise TypeError("these splats have plain channels")
    return splats.colors.coefficients


def random_splats(
    n: int, degree: int = 1, seed: int = 0, dtype: torch.dtype = torch.float32
) -> Splats:
    """Splats in a unit cube around the origin, in quats-and-scales form."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    return Splats(
        means=(2 * uniform(n, 3) - 1).to(dtype),
        opacities=(0.1 + 0.85 * uniform(n)).to(dtype),
        colors=Sh((0.4 * normal(n, (degree + 1) ** 2, 3)).to(dtype), degree),
        quats=normal(n, 4).to(dtype),
        scales=(0.02 + 0.15 * uniform(n, 3)).to(dtype),
    )


def front_camera(
    width: int = 40, height: int = 30, distance: float = 4.0, dtype: torch.dtype = torch.float32
) -> Cameras:
    """One pinhole camera that looks along +z at the origin."""
    world_to_camera = torch.eye(4, dtype=torch.float64)
    world_to_camera[2, 3] = distance
    intrinsics = torch.tensor(
        [[1.2 * width, 0.0, width / 2], [0.0, 1.2 * width, height / 2], [0.0, 0.0, 1.0]],
        dtype=torch.float64,
    )
    return Cameras(world_to_camera[None].to(dtype), intrinsics[None].to(dtype), width, height)


def layers(count: int, opacity: float, channels: int = 1) -> Splats:
    """Splats of the same place and shape, in the order of their rows."""
    shades = torch.linspace(0, 1, count)[:, None]
    return Splats(
        means=torch.zeros(count, 3),
        opacities=torch.full((count,), opacity),
        colors=shades.repeat(1, channels),
        quats=torch.ones(count, 4),
        scales=torch.tensor([[1.0, 0.8, 0.6]]).repeat(count, 1),
    )
