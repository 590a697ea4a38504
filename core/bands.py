"""Bands: images in strips of pixel rows, rendered from splats that several processes have.

Every process projects its own splats, and sends each to the bands that it reaches. A band is
blended from the splats of all, and returns sums for each of them, from which their processes
compute gradients. The numbers that are sent are the rasterizer's own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

from jaxtyping import Float
from torch import Tensor

from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.splats import Splats


class BandedSplats(ABC):
    """Splats of one process in some images, divided by the bands that they may reach."""

    rows: Float[Tensor, "m k"]
    """One row for each splat and band, band after band; without a graph."""
    counts: tuple[int, ...]
    """Number of rows of each band; bands of the first image come first."""
    num_sums: int
    """Sums that a band returns for each row."""

    @abstractmethod
    def gradient(self, sums: Float[Tensor, "m s"]) -> tuple[Tensor, Tensor]:
        """A tensor in the graph of the splats, and its gradient, which follows from ``sums``."""

    @abstractmethod
    def statistics(self, sums: Float[Tensor, "m s"]) -> RenderStatistics:
        """The statistics of all splats, after the backward pass of ``gradient``."""


class RenderedBand(ABC):
    """One band of an image."""

    image: Float[Tensor, "h w d"]
    """All channels, without a graph."""
    alpha: Float[Tensor, "h w"]

    @abstractmethod
    def sums(
        self, image: Float[Tensor, "h w d"] | None, alpha: Float[Tensor, "h w"] | None
    ) -> Float[Tensor, "m s"]:
        """Sums for each row of ``render``, from the gradients of image and alpha; once."""


class Bands(ABC):
    """The bands of the images of a render."""

    channels: int
    """Channels of the image of a band."""

    @abstractmethod
    def project(self, splats: Splats) -> BandedSplats:
        """Project some splats into all images."""

    @abstractmethod
    def render(self, band: int, rows: Float[Tensor, "m k"]) -> RenderedBand:
        """Render a band.

        Args:
            band: its number, from above; bands of the first image come first.
            rows: splats that may reach it, as ``project`` returns them, of all processes.
        """

    @abstractmethod
    def output(
        self, image: Float[Tensor, "c h w d"], alpha: Float[Tensor, "c h w 1"]
    ) -> RenderOutput:
        """The images of a render, from all bands together; without statistics of splats."""
