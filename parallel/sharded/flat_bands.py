"""Flat bands: the bands of images by any rasterizer that has orthographic cameras.

Flat splats are exchanged. They are projected in plain torch, so that a rasterizer with kernels for
bands (``Rasterizer.bands``) is several times as fast.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.bands import BandedSplats, Bands, RenderedBand
from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.parallel.sharded.flat_splats import band_camera, drawn, project

GRADIENTS = frozenset({Statistic.SCREEN_GRADIENT})
"""Statistics that follow from the gradients of flat splats; bands need not measure them."""


class FlatBands(Bands):
    """The bands of some images, by a rasterizer that has orthographic cameras."""

    def __init__(
        self,
        rasterizer: Rasterizer,
        splats: Splats,
        cameras: Cameras,
        settings: RenderSettings,
        pixels: Sequence[range],
    ) -> None:
        """Render nothing yet; arguments are those of ``Rasterizer.bands``.

        Raises:
            ConfigError: a statistic cannot be added up over bands.
        """
        if Statistic.ABSGRAD in settings.statistics:
            raise ConfigError(
                "absolute gradients (strategy.absgrad=true) are sums over a whole image, and "
                f"{type(rasterizer).__name__} has no kernels that add them up over bands.",
                "Train with strategy.absgrad=false, with shards=0, or with rasterizer=cpu.",
            )
        self._rasterizer, self._settings = rasterizer, settings
        self._cameras = [cameras.select([index]) for index in range(len(cameras))]
        self._like, self._pixels = splats, pixels
        self._extras = 0 if splats.extra is None else splats.extra.shape[1]
        self.channels = splats.channels + self._extras + (settings.depth is not Depth.NONE)

    def project(self, splats: Splats) -> FlatBandedSplats:
        """Project some splats into all images."""
        images = [
            FlatImage(splats, camera, self._settings, self._pixels) for camera in self._cameras
        ]
        return FlatBandedSplats(images, self._settings)

    def render(self, band: int, rows: Float[Tensor, "m k"]) -> FlatRenderedBand:
        """Render a band."""
        image, number = divmod(band, len(self._pixels))
        pixels, weights = self._pixels[number], self._settings.contribution_weights
        splats = rows.detach().requires_grad_(torch.is_grad_enabled())
        settings = replace(
            self._settings,
            background=None,  # Added to the whole image, as it may be learned.
            statistics=self._settings.statistics - GRADIENTS,
            contribution_weights=None
            if weights is None
            else weights[image : image + 1, pixels.start : pixels.stop].contiguous(),
        )
        camera = band_camera(self._cameras[image], pixels)
        return FlatRenderedBand(
            splats, self._rasterizer.render(drawn(splats, self._like.channels), camera, settings)
        )

    def output(
        self, image: Float[Tensor, "c h w d"], alpha: Float[Tensor, "c h w 1"]
    ) -> RenderOutput:
        """The images of a render, from all bands together."""
        like, settings = self._like, self._settings
        ends = [like.channels, like.channels + self._extras]
        color, extra, depth = image.tensor_split(ends, dim=3)
        if settings.background is not None:
            color = color + (1.0 - alpha) * settings.background
        return RenderOutput(
            color=color,
            alpha=alpha,
            statistics=RenderStatistics.zeros(like.means, len(image), frozenset()),
            depth=None if settings.depth is Depth.NONE else depth,
            extra=extra if self._extras else None,
        )


class FlatBandedSplats(BandedSplats):
    """Flat splats of one process in some images, divided by the bands that they may reach."""

    def __init__(self, images: Sequence[FlatImage], settings: RenderSettings) -> None:
        """Join the flat splats of all images."""
        self._images = images
        self._values = torch.cat([image.values for image in images])
        self.rows = self._values.detach()
        self.counts = tuple(count for image in images for count in image.counts)
        self._width = self.rows.shape[1]
        self.num_sums = self._width + 2 + (Statistic.CONTRIBUTION in settings.statistics)

    def gradient(self, sums: Float[Tensor, "m s"]) -> tuple[Tensor, Tensor]:
        """The values that were sent, and their gradients; bands are added in their order."""
        return self._values, sums[:, : self._width]

    def statistics(self, sums: Float[Tensor, "m s"]) -> RenderStatistics:
        """The statistics of all splats."""
        parts = sums.split([sum(image.counts) for image in self._images])
        pairs = zip(self._images, parts, strict=True)
        return RenderStatistics.cat([image.statistics(part, self._width) for image, part in pairs])


class FlatImage:
    """Flat splats of one process in one image, divided by bands."""

    def __init__(
        self, splats: Splats, camera: Cameras, settings: RenderSettings, pixels: Sequence[range]
    ) -> None:
        """Project splats; ``pixels`` has the rows of pixels of each band."""
        self._splats, self._camera, self._settings = splats, camera, settings
        flat = project(splats, camera, settings)
        sent = [flat.reaching(band) for band in pixels]
        self.counts = list(map(len, sent))
        order = torch.cat(sent)
        self._rows = flat.rows.index_select(0, order)
        self.values = flat.values.index_select(0, order)
        """Values of each splat, for each band that it may reach; attached to the graph."""

    def statistics(self, sums: Float[Tensor, "m s"], width: int) -> RenderStatistics:
        """The statistics of all splats; ``sums`` has gradients of ``width`` values first."""
        found = RenderStatistics.zeros(self._splats.means, 1, self._settings.statistics)
        bands = zip(self._rows.split(self.counts), sums.split(self.counts), strict=True)
        for rows, measured in bands:
            visible, radii = measured[:, width : width + 2].unbind(1)
            found.visible[0, rows] |= visible > 0
            found.radii[0, rows] = torch.maximum(found.radii[0, rows], radii)
            if found.contribution is not None:
                found.contribution[0].index_add_(0, rows, measured[:, width + 2])
        if self._settings.profile.alpha_min <= 0:  # All reach the whole image, not their bands.
            whole = 0.5 * max(self._camera.width, self._camera.height)
            found.radii.masked_fill_(found.visible, whole)
        if found.screen_gradient is not None:
            by_mean = sums.new_zeros(len(self._splats), 2)
            by_mean.index_add_(0, self._rows, sums[:, :2].contiguous())
            half = 0.5 * sums.new_tensor([self._camera.width, self._camera.height])
            found.screen_gradient[0] = (by_mean * half).norm(dim=1)
        return found


class FlatRenderedBand(RenderedBand):
    """One band, kept for its backward pass."""

    def __init__(self, splats: Float[Tensor, "m k"], output: RenderOutput) -> None:
        """Take a render of flat splats."""
        images = [output.color, output.extra, output.depth]
        self._image = torch.cat([image[0] for image in images if image is not None], dim=-1)
        self._splats, self._output = splats, output
        self.image, self.alpha = self._image.detach(), output.alpha.detach()[0, :, :, 0]

    def sums(
        self, image: Float[Tensor, "h w d"] | None, alpha: Float[Tensor, "h w"] | None
    ) -> Float[Tensor, "m s"]:
        """Gradients of the flat splats, their visibility, radii and contributions."""
        pairs = [(self._image, image), (self._output.alpha[0, :, :, 0], alpha)]
        pairs = [(to, by) for to, by in pairs if by is not None and to.requires_grad]
        if pairs:
            torch.autograd.backward([to for to, _ in pairs], [by for _, by in pairs])
        gradient, seen = self._splats.grad, self._output.statistics
        if gradient is None:
            gradient = torch.zeros_like(self._splats)
        measured = [gradient, seen.visible.T.to(gradient), seen.radii.T.to(gradient)]
        if seen.contribution is not None:
            measured.append(seen.contribution.T.to(gradient))
        return torch.cat(measured, dim=1)
