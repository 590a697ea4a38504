"""The interface of diff-gaussian-rasterization (Kerbl et al. 2023), on any backend of gsfw.

    from gsfw.compat.diff_gaussian_rasterization import GaussianRasterizer

Differences from the CUDA extension: a splat ends where its alpha falls to 1 / 255, not at the
tiles around three standard deviations; where alpha is clamped to 0.99, and where x / z or y / z is
clamped to 1.3 tangents of half the view, gradients are those of the clamped function (the extension
passes some through); depth has a gradient, which some forks lack.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from gsfw.api import ConfigError, NumericsProfile, RenderStatistics, Statistic, Validation
from gsfw.compat.inria_gradients import AbsoluteGradient, ScreenGradient
from gsfw.compat.inria_projection import InriaGaussians, InriaView, mip_compensation, project
from gsfw.compat.inria_relocation import compute_relocation
from gsfw.compat.refusal import refuse, refuse_unknown
from gsfw.compat.screen import (
    Covariances,
    ScreenSplats,
    ScreenView,
    compensation,
    dilated,
    render_screen,
)

__all__ = ["GaussianRasterizationSettings", "GaussianRasterizer", "compute_relocation"]

THIRD_OUTPUT = "GSFW_THIRD_OUTPUT"
"""Variable with what is returned besides colour and radii: see ``GaussianRasterizer``."""
NONE, DEPTH, INVERSE_DEPTH = "none", "depth", "invdepth"

SETTINGS, RASTERIZER = "GaussianRasterizationSettings", "GaussianRasterizer"


class _Settings(NamedTuple):
    """The fields, with the original's names."""

    image_height: int
    image_width: int
    tanfovx: float
    tanfovy: float
    bg: Float[Tensor, " d"]
    scale_modifier: float
    viewmatrix: Float[Tensor, "4 4"]
    """World to camera, transposed."""
    projmatrix: Float[Tensor, "4 4"]
    """World to clip space, transposed."""
    sh_degree: int
    campos: Float[Tensor, " 3"]
    prefiltered: bool
    """Splats behind the near plane are an error."""
    debug: bool = False
    """All values of all inputs are checked before rendering."""
    antialiasing: bool | None = None
    """``None`` for versions that have no such setting, and return no depth."""
    kernel_size: float | None = None
    """Dilation of mip-splatting, in pixels squared; ``None`` for versions without this setting."""
    subpixel_offset: Float[Tensor, "h w 2"] | None = None
    """Zeros; mip-splatting moves the centres of pixels by it."""


class GaussianRasterizationSettings(_Settings):
    """A view."""

    __slots__ = ()

    def __new__(cls, *values: Any, **named: Any) -> GaussianRasterizationSettings:  # noqa: ANN401
        """Settings of the original; those of forks are refused by name."""
        refuse_unknown(SETTINGS, {name: named[name] for name in named if name not in cls._fields})
        made = super().__new__(cls, *values, **named)
        if made.subpixel_offset is not None and bool(made.subpixel_offset.any()):
            raise refuse(
                SETTINGS,
                "a subpixel_offset that is not 0",
                "Train without ray_jitter, as mip-splatting does by default.",
            )
        return made

    def view(self) -> InriaView:
        """The view that is projected to."""
        return InriaView(
            width=self.image_width,
            height=self.image_height,
            tangents=(self.tanfovx, self.tanfovy),
            view=self.viewmatrix,
            projection=self.projmatrix,
            center=self.campos,
            degree=self.sh_degree,
            scale=self.scale_modifier,
            compensation=self._compensation(),
            profile=NumericsProfile() if self.kernel_size is None else dilated(self.kernel_size),
        )

    def _compensation(self) -> Callable[[Covariances, NumericsProfile], Tensor] | None:
        if self.kernel_size is not None:
            return mip_compensation
        return compensation if self.antialiasing else None


class GaussianRasterizer(nn.Module):
    """Renders one view.

    Returns colour [d, h, w], radii [n], and in some versions a third image [1, h, w]. With
    ``antialiasing`` in the settings this is inverse depth (the sum of weight over view depth), with
    ``means2D_densify`` depth (the sum of weight times view depth), else there is none. Other forks
    are told by the environment: GSFW_THIRD_OUTPUT=none, depth or invdepth.
    """

    def __init__(self, raster_settings: GaussianRasterizationSettings) -> None:
        super().__init__()
        self.raster_settings = raster_settings

    @torch.no_grad()
    def visible_filter(
        self,
        means3D: Float[Tensor, "n 3"],
        scales: Float[Tensor, "n 3"] | None = None,
        rotations: Float[Tensor, "n 4"] | None = None,
        cov3D_precomp: Float[Tensor, "n 6"] | None = None,
    ) -> Int[Tensor, " n"]:
        """Radii in pixels, 0 outside of the image, which Scaffold-GS reads before it renders.

        Raises:
            ValueError: there are both axes and covariances, or neither.
        """
        # Radii depend on neither opacities nor colours.
        opacities, colors = torch.ones_like(means3D[:, :1]), means3D[:, :0]
        gaussians = InriaGaussians(
            means3D, opacities, None, colors, scales, rotations, cov3D_precomp
        )
        _check(gaussians, means3D, 0)
        rows = _rows_in_front(self.raster_settings, means3D)
        radii = project(_taken(gaussians, rows), self.raster_settings.view())[1]
        return _of_all(radii, rows, len(means3D))

    @torch.no_grad()
    def markVisible(self, positions: Float[Tensor, "n 3"]) -> Bool[Tensor, " n"]:
        """True for the points beyond the near plane."""
        return self.raster_settings.view().in_front(positions)

    def forward(
        self,
        means3D: Float[Tensor, "n 3"],
        means2D: Float[Tensor, "n _"] | None,
        opacities: Float[Tensor, "n 1"],
        shs: Float[Tensor, "n k 3"] | None = None,
        colors_precomp: Float[Tensor, "n d"] | None = None,
        scales: Float[Tensor, "n 3"] | None = None,
        rotations: Float[Tensor, "n 4"] | None = None,
        cov3D_precomp: Float[Tensor, "n 6"] | None = None,
        means2D_densify: Float[Tensor, "n 3"] | None = None,
        dc: Float[Tensor, "n 1 3"] | None = None,
        **of_forks: Any,  # noqa: ANN401
    ) -> tuple[Tensor, ...]:
        """Colour, radii, and the third image of some versions.

        Args:
            means3D: centres, in scene units.
            means2D: not read. Its gradient is the one by the centres in normalized device
                coordinates (by pixels, times half the image size). Column 2 is 0; with
                ``kernel_size`` in the settings it is column 0 of ``means2D_densify``.
            opacities: in [0, 1].
            shs: spherical harmonics; or ``colors_precomp``.
            colors_precomp: as many channels as the background.
            scales: standard deviations, with ``rotations``; or ``cov3D_precomp``.
            rotations: wxyz; not normalised, as in the original.
            cov3D_precomp: upper halves of covariances, row by row.
            means2D_densify: not read. Column 0 of its gradient is the norm of the two sums of
                absolute gradients (AbsGS); forks read no more than the norm.
            dc: the first of the spherical harmonics, in forks whose ``shs`` has only the others.
            of_forks: anything else is refused.

        Raises:
            UnservedArgument: an argument is of a fork that gsfw does not serve.
            ValueError: the combination of arguments is not the original's.
        """
        settings = self.raster_settings
        refuse_unknown(RASTERIZER, of_forks)
        if dc is not None:
            shs = dc if shs is None else torch.cat([dc, shs], dim=1)
        gaussians = InriaGaussians(
            means3D, opacities, shs, colors_precomp, scales, rotations, cov3D_precomp
        )
        _check(gaussians, means2D, settings.sh_degree)
        assert means2D is not None, "it was checked"
        return _render(settings, gaussians, means2D, means2D_densify)


def _render(
    settings: GaussianRasterizationSettings,
    gaussians: InriaGaussians,
    means2D: Float[Tensor, "n _"],
    densify: Float[Tensor, "n 3"] | None,
) -> tuple[Tensor, ...]:
    """Render checked arguments."""
    rows, view = _rows_in_front(settings, gaussians.means), settings.view()
    splats, radii = project(_taken(gaussians, rows), view)
    third = _third_output(settings, densify is not None)
    means = splats.means + ScreenGradient.apply(_take(means2D, rows), view)
    measured: list[RenderStatistics] = []
    receivers = _receivers(settings, means2D, densify)
    for receiver, column in receivers:
        means = means + AbsoluteGradient.apply(_take(receiver, rows), column, measured)
    splats = replace(splats, means=means, channels=_with_third(splats, third))
    output = render_screen(splats, _screen_view(settings, third, bool(receivers)))
    # The statistics alone: the image would hold this step's graph, which holds the list.
    measured.append(output.statistics)
    radii = _of_all(radii, rows, len(gaussians.means))
    image = output.color[0].permute(2, 0, 1)
    return (image, radii) if third == NONE else (image[:-1], radii, image[-1:])


def _receivers(
    settings: GaussianRasterizationSettings,
    means2D: Float[Tensor, "n _"],
    densify: Float[Tensor, "n 3"] | None,
) -> list[tuple[Tensor, int]]:
    """Tensors that receive absolute gradients, each with the column for them."""
    mip = settings.kernel_size is not None and means2D.shape[1] == 3 and means2D.requires_grad
    return [(means2D, 2)] * mip + ([] if densify is None else [(densify, 0)])


def _check(gaussians: InriaGaussians, means2D: Tensor | None, degree: int) -> None:
    """Check for the original's combinations.

    Raises:
        ValueError: there is another.
    """
    if means2D is None:
        raise ValueError(
            f"{RASTERIZER}: expected means2D of shape [n, 3], found None. Pass "
            "torch.zeros_like(means3D); with requires_grad it receives the gradient."
        )
    if (gaussians.shs is None) == (gaussians.colors is None):
        raise ValueError(f"{RASTERIZER}: give either shs or colors_precomp.")
    if gaussians.shs is not None and (degree + 1) ** 2 > gaussians.shs.shape[1]:
        raise ValueError(
            f"{SETTINGS}: sh_degree={degree} has {(degree + 1) ** 2} coefficients, but shs has "
            f"{gaussians.shs.shape[1]} (shape {list(gaussians.shs.shape)}). Lower sh_degree."
        )
    axes = (gaussians.scales is not None, gaussians.rotations is not None)
    if axes[0] != axes[1] or axes[0] == (gaussians.covariances is not None):
        raise ValueError(f"{RASTERIZER}: give either scales and rotations, or cov3D_precomp.")
    if means2D.shape[1] not in (2, 3):
        raise ValueError(
            f"{RASTERIZER}: expected means2D of shape [n, 3], found {list(means2D.shape)}. For "
            "absolute gradients pass a second tensor, means2D_densify, as some forks do."
        )


def _rows_in_front(
    settings: GaussianRasterizationSettings, means: Float[Tensor, "n 3"]
) -> Int[Tensor, " m"] | None:
    """Rows beyond the near plane; ``None`` for all, which need no copy.

    Raises:
        ValueError: there are others, and the settings rule them out.
    """
    front = settings.view().in_front(means.detach())
    count = int(front.sum())
    if count == len(front):
        return None
    if settings.prefiltered:
        raise ValueError(
            f"{SETTINGS}: prefiltered=True, but {len(front) - count} of {len(front)} splats are "
            "behind the near plane. Filter them with markVisible, or pass prefiltered=False."
        )
    return front.nonzero()[:, 0]


def _of_all(
    values: Int[Tensor, " m"], rows: Int[Tensor, " m"] | None, count: int
) -> Int[Tensor, " n"]:
    """Values of some rows, and 0 for the others."""
    return values if rows is None else values.new_zeros(count).index_copy(0, rows, values)


def _take(tensor: Tensor, rows: Int[Tensor, " m"] | None) -> Tensor:
    return tensor if rows is None else tensor.index_select(0, rows)


def _taken(gaussians: InriaGaussians, rows: Int[Tensor, " m"] | None) -> InriaGaussians:
    parts = [None if part is None else _take(part, rows) for part in vars(gaussians).values()]
    return InriaGaussians(*parts)  # type: ignore[arg-type]


def _third_output(settings: GaussianRasterizationSettings, densify: bool) -> str:
    """The kind of the third image.

    Raises:
        ConfigError: the environment names no kind.
    """
    asked = os.environ.get(THIRD_OUTPUT, "")
    if asked not in ("", NONE, DEPTH, INVERSE_DEPTH):
        raise ConfigError(
            f"{THIRD_OUTPUT}={asked}: expected {NONE}, {DEPTH} or {INVERSE_DEPTH}.",
            f"{THIRD_OUTPUT}={DEPTH} is for forks that return (color, radii, depth).",
        )
    if asked or densify:
        return asked or DEPTH
    return NONE if settings.antialiasing is None else INVERSE_DEPTH


def _with_third(splats: ScreenSplats, third: str) -> Float[Tensor, "m e"]:
    """The channels, and that of the third image."""
    if third == NONE:
        return splats.channels
    depths = splats.depths[:, None]
    return torch.cat([splats.channels, depths if third == DEPTH else 1 / depths], dim=1)


def _screen_view(settings: GaussianRasterizationSettings, third: str, absolute: bool) -> ScreenView:
    background = settings.bg
    return ScreenView(
        width=settings.image_width,
        height=settings.image_height,
        background=background
        if third == NONE
        else torch.cat([background, background.new_zeros(1)]),
        profile=settings.view().profile,
        statistics=frozenset({Statistic.ABSGRAD} if absolute else ()),
        validation=Validation.FULL if settings.debug else Validation.CHEAP,
    )
