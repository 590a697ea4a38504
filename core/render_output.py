"""RenderOutput: the images and statistics that a rasterizer returns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.render_settings import Statistic

MOST_IMAGES = 8
"""Images of a render that a notebook shows."""


@dataclass(frozen=True)
class RenderStatistics:
    """Values per camera and splat, in the order of the splats (``Splats.rows`` maps to the model).

    The forward pass returns the gradient statistics as zeros; backward fills them in place.
    Density strategies read these tensors, never the ``.grad`` of intermediate ones.
    """

    visible: Bool[Tensor, "c n"]
    """True where the splat can reach a pixel: in front, in the image, opaque enough."""
    radii: Float[Tensor, "c n"]
    """Half of the larger side of the splat's exact bounding box, in pixels; 0 where invisible."""
    screen_gradient: Float[Tensor, "c n"] | None = None
    """|dL / d centre| with the centre in NDC: pixel gradients times (width / 2, height / 2)."""
    absgrad: Float[Tensor, "c n"] | None = None
    """The same with each pixel's absolute gradient summed instead (Ye et al. 2024, AbsGS)."""
    contribution: Float[Tensor, "c n"] | None = None
    """Sum over pixels of alpha times transmittance, each times the pixel's weight in
    ``RenderSettings.contribution_weights``; written by the forward pass."""

    @staticmethod
    def zeros(
        means: Float[Tensor, "n 3"], cameras: int, wanted: frozenset[Statistic]
    ) -> RenderStatistics:
        """Zeros, with tensors for the ``wanted`` statistics."""
        shape = (cameras, len(means))

        def room(statistic: Statistic) -> Tensor | None:
            return means.new_zeros(shape) if statistic in wanted else None

        return RenderStatistics(
            visible=means.new_zeros(shape, dtype=torch.bool),
            radii=means.new_zeros(shape),
            screen_gradient=room(Statistic.SCREEN_GRADIENT),
            absgrad=room(Statistic.ABSGRAD),
            contribution=room(Statistic.CONTRIBUTION),
        )

    def map(self, function: Callable[[Tensor], Tensor]) -> RenderStatistics:
        """Apply ``function`` to every statistic that was measured."""
        named = {item.name: getattr(self, item.name) for item in fields(self)}
        measured = {name: value for name, value in named.items() if value is not None}
        return replace(self, **{name: function(value) for name, value in measured.items()})

    @staticmethod
    def cat(parts: Sequence[RenderStatistics]) -> RenderStatistics:
        """Join the statistics of several cameras; all have the same ones, of as many splats."""
        names = [item.name for item in fields(RenderStatistics)]
        return RenderStatistics(**{name: _joined(parts, name) for name in names})

    @staticmethod
    def joined_rows(parts: Sequence[RenderStatistics]) -> RenderStatistics:
        """Join the statistics of several sets of splats; all have the same ones, and cameras."""
        names = [item.name for item in fields(RenderStatistics)]
        return RenderStatistics(**{name: _joined(parts, name, dim=1) for name in names})

    def split(self, cameras: Sequence[int]) -> list[RenderStatistics]:
        """The statistics of successive cameras, so many in each part."""
        names = [item.name for item in fields(self)]
        parts = {n: v.split(list(cameras)) for n in names if (v := getattr(self, n)) is not None}
        return [
            RenderStatistics(**{name: found[place] for name, found in parts.items()})
            for place in range(len(cameras))
        ]

    def where(self, finite: Bool[Tensor, ""]) -> RenderStatistics:
        """The same statistics, or zeros if ``finite`` is false; no synchronisation."""
        if known_by_host(finite):
            return self
        skipped = ~finite
        return self.map(lambda values: values.masked_fill(skipped, 0))


def known_by_host(flag: Bool[Tensor, ""]) -> bool:
    """True if a flag is true and the host knows it without waiting."""
    return flag.is_cpu and bool(flag)


@dataclass(frozen=True)
class RenderOutput:
    """Images of ``c`` cameras: ``h`` by ``w`` pixels with ``d`` channels."""

    color: Float[Tensor, "c h w d"]
    """Colour, composited over the background; not clamped."""
    alpha: Float[Tensor, "c h w 1"]
    """1 - remaining transmittance; 0 where there is no splat."""
    statistics: RenderStatistics
    """Values per camera and splat."""
    depth: Float[Tensor, "c h w 1"] | None = None
    """Depth in scene units; ``None`` when not requested."""
    extra: Float[Tensor, "c h w e"] | None = None
    """The splats' extra channels over background 0; ``None`` when they have none."""

    @staticmethod
    def cat(parts: Sequence[RenderOutput]) -> RenderOutput:
        """Join the images of several cameras; all have the same outputs and size."""
        statistics = RenderStatistics.cat([part.statistics for part in parts])
        names = [item.name for item in fields(RenderOutput) if item.name != "statistics"]
        return RenderOutput(statistics=statistics, **{n: _joined(parts, n) for n in names})

    def _repr_html_(self) -> str:
        """The first images, for notebooks."""
        from gsfw.core.embedded_image import image_element  # Only notebooks need Pillow.

        count, height, width = self.color.shape[:3]
        more = f"; the first {MOST_IMAGES} of them" if count > MOST_IMAGES else ""
        images = "".join(
            image_element(self.color[index], f"camera {index}")
            for index in range(min(count, MOST_IMAGES))
        )
        head = f"{count} image{'s' * (count != 1)} of {width} x {height} pixels{more}"
        return f"<div>{head}</div><div>{images}</div>"


def _joined(parts: Sequence[object], name: str, dim: int = 0) -> Any:  # noqa: ANN401
    """One field of several renders, camera after camera; ``None`` if they lack it."""
    found = [getattr(part, name) for part in parts]
    return None if found[0] is None else torch.cat(found, dim=dim)
