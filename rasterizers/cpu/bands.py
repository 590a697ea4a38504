"""Bands of the CPU rasterizer: projected splats are exchanged, and the sums of blending them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsfw.core.bands import BandedSplats, Bands, RenderedBand
from gsfw.core.cameras import Cameras
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.kernels.cpu.native_module import native_class, required
from gsfw.kernels.cpu.threads import num_threads
from gsfw.kernels.render_arguments import (
    POSE_FIELDS,
    BandGradients,
    BandInputs,
    BandOutputs,
    PackedRows,
    RowGradients,
    RowOutputs,
    SplatArrays,
    SplatGradients,
)
from gsfw.rasterizers.autograd import check_cameras, composed, flat_inputs, pose_gradient
from gsfw.rasterizers.kernel_arguments import PairLimit, RenderCall, render_call, row_of

TILE = 16
"""Bands are whole tiles high."""


class CpuBands(Bands):
    """The bands of some images, by the native kernels."""

    def __init__(
        self,
        limit: PairLimit,
        splats: Splats,
        cameras: Cameras,
        settings: RenderSettings,
        pixels: Sequence[range],
    ) -> None:
        """Render nothing yet.

        Args:
            limit: of tile intersections of a band.
            splats: have the channels of all splats of the images.
            cameras: one per image.
            settings: the settings of the render.
            pixels: rows of pixels of each band of an image.
        """
        check_cameras("cpu", cameras)
        self._limit, self._like, self._cameras, self._settings = limit, splats, cameras, settings
        self._pixels = pixels
        self._band_height = -(-len(pixels[0]) // TILE) * TILE
        # Of no rows: bands need its settings, and to know which statistics are wanted.
        self._call = self._call_of(splats.take(torch.arange(0)), torch.is_grad_enabled())
        self.channels = len(self._call.background)
        self._width = required().SENT_FIELDS + self.channels

    def _call_of(self, splats: Splats, differentiated: bool) -> RenderCall:
        cameras, settings = self._cameras, self._settings
        statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
        return render_call(splats, cameras, settings, statistics, self._limit, differentiated)

    def project(self, splats: Splats) -> CpuBandedSplats:
        """Project some splats into all images."""
        tensors, offsets = flat_inputs(splats, self._cameras)
        wanted = torch.is_grad_enabled() and any(t is not None and t.requires_grad for t in tensors)
        call = self._call_of(splats, wanted)
        arrays: list[Any] = [*tensors[:-1], offsets]
        kind, seen = native_class("BandedRows", splats.means.dtype), call.statistics
        images, packed = [], []
        for index in range(len(self._cameras)):
            image = kind(
                call.inputs(SplatArrays(*arrays), index).detached(),
                call.settings,
                RowOutputs(seen.visible[index], seen.radii[index]),
                self._band_height,
                num_threads(),
            )
            # At once: the next image then has the memory of its projected splats.
            rows = call.background.new_empty(sum(image.counts), self._width)
            image.pack(PackedRows(rows))
            images.append(image)
            packed.append(rows)
        return CpuBandedSplats(images, torch.cat(packed), call, tensors)

    def render(self, band: int, rows: Float[Tensor, "m k"]) -> CpuRenderedBand:
        """Render a band.

        Raises:
            ConfigError: it has more tile intersections than it may have.
        """
        image, number = divmod(band, len(self._pixels))
        pixels, weights = self._pixels[number], self._call.pixel_weights
        inputs = BandInputs(
            rows=rows,
            top=pixels.start,
            background=self._call.background,
            pixel_weights=None if weights is None else weights[image, pixels.start : pixels.stop],
        )
        return CpuRenderedBand(inputs, self._call, len(pixels))

    def output(
        self, image: Float[Tensor, "c h w d"], alpha: Float[Tensor, "c h w 1"]
    ) -> RenderOutput:
        """The images of a render, from all bands together."""
        nowhere = RenderStatistics.zeros(self._like.means, len(image), frozenset())
        return composed(image, alpha, self._like, self._settings, nowhere)


class CpuBandedSplats(BandedSplats):
    """Splats in some images, divided by bands in native memory."""

    def __init__(
        self,
        images: Sequence[Any],
        rows: Float[Tensor, "m k"],
        call: RenderCall,
        tensors: Sequence[Any],
    ) -> None:
        """Take the projected splats.

        Args:
            images: ``BandedRows`` of the native module, of each image.
            rows: those that they have packed.
            call: the call that they belong to.
            tensors: those that they can be differentiated by.
        """
        measured, like = call.statistics, call.background
        self.counts = tuple(count for image in images for count in image.counts)
        self.rows = rows
        totals = [sum(image.counts) for image in images]
        self.num_sums = required().SLOT_FIELDS + len(like)
        self.num_sums += 2 * (measured.absgrad is not None) + (measured.contribution is not None)
        self._call = call
        self._root = _Project.apply(images, call, totals, self.num_sums, *tensors)

    def gradient(self, sums: Float[Tensor, "m s"]) -> tuple[Tensor, Tensor]:
        """A tensor that takes the sums as its gradient."""
        return self._root, sums

    def statistics(self, sums: Float[Tensor, "m s"]) -> RenderStatistics:
        """The statistics of all splats, which the kernels have written."""
        return self._call.statistics


class _Project(torch.autograd.Function):
    """Projection as a function whose gradient, the sums of blending, has a shape of its own."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401
        images: Sequence[Any],
        call: RenderCall,
        totals: list[int],
        width: int,
        *tensors: Any,  # noqa: ANN401 - a tensor or None, by position.
    ) -> Tensor:
        ctx.save_for_backward(*tensors)
        ctx.images, ctx.call, ctx.totals = images, call, totals
        # Its values are never read.
        return call.background.new_zeros(()).expand(sum(totals), width)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, sums: Tensor) -> Any:  # noqa: ANN401
        *inputs, pose = ctx.saved_tensors
        *rows_wanted, pose_wanted = ctx.needs_input_grad[4:]
        measured = ctx.call.statistics
        gradients = [
            torch.empty_like(tensor) if wanted else None
            for tensor, wanted in zip(inputs, rows_wanted, strict=True)
        ]
        poses = sums.new_zeros(len(ctx.images), POSE_FIELDS) if pose_wanted else None
        parts = sums.contiguous().split(ctx.totals)
        for index, (image, part) in enumerate(zip(ctx.images, parts, strict=True)):
            image.backward(
                RowGradients(
                    sums=part,
                    splats=SplatGradients(*gradients),
                    accumulate=index > 0,
                    pose=row_of(poses, index),
                    screen_gradient=row_of(measured.screen_gradient, index),
                    absgrad=row_of(measured.absgrad, index),
                    contribution=row_of(measured.contribution, index),
                )
            )
        by_pose = None if poses is None else pose_gradient(poses, pose)
        return None, None, None, None, *gradients, by_pose


class CpuRenderedBand(RenderedBand):
    """One band in native memory."""

    def __init__(self, inputs: BandInputs, call: RenderCall, height: int) -> None:
        """Blend a band of ``height`` rows of pixels."""
        like, wanted = call.background, call.statistics
        settings = replace(call.settings, height=height)
        self._absolute = wanted.absgrad is not None
        self._contribution = (
            like.new_empty(len(inputs.rows)) if wanted.contribution is not None else None
        )
        self.image = like.new_empty(height, settings.width, len(like))
        self.alpha = like.new_empty(height, settings.width)
        outputs = BandOutputs(self.image, self.alpha, self._contribution)
        self._count = len(inputs.rows)
        try:
            self._band = native_class("Band", like.dtype)(inputs, settings, outputs, num_threads())
        except required().TooManyPairs as refused:
            raise call.limit.refuse(refused.args[0]) from None

    def sums(
        self, image: Float[Tensor, "h w d"] | None, alpha: Float[Tensor, "h w"] | None
    ) -> Float[Tensor, "m s"]:
        """Sums over the pixels of each splat; see ``SlotField`` in kernels/cpu/native/stages.h."""
        width = required().SLOT_FIELDS + self.image.shape[2] + 2 * self._absolute
        sums = self.image.new_empty(self._count, width)
        by_image = torch.zeros_like(self.image) if image is None else image.contiguous()
        by_alpha = None if alpha is None else alpha.contiguous()
        self._band.backward(BandGradients(by_image, by_alpha, self._absolute, sums))
        if self._contribution is None:
            return sums
        return torch.cat([sums, self._contribution[:, None]], dim=1)
