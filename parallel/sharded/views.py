"""Views: images that all processes render together, and their backward pass.

Forward: every process projects its rows into all images, shard by shard, and sends the splats to
the processes whose bands they reach; each renders its bands, and sends them to all. Backward: every
process has the gradients of the whole images, goes back through its bands, and returns sums for
each splat to the process that sent it. They are added in the order of the bands.

Per image and process that is, of m splats with k values and s sums that reach b bands each, and N
processes, up to a splat in the last band,

    4 s m b (N - 1) / N^2 bytes backward, 4 k of them forward, and the image itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.bands import BandedSplats, Bands, RenderedBand
from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError, UserError
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import RenderSettings
from gsfw.core.returns import splats_to_render
from gsfw.core.splats import Splats
from gsfw.parallel.group import Group
from gsfw.parallel.sharded.division import Division
from gsfw.parallel.sharded.flat_bands import FlatBands
from gsfw.parallel.sharded.window import Window


@dataclass(frozen=True)
class Shard:
    """The rows of one shard of the model in a render."""

    window: Window
    splats: Splats
    banded: BandedSplats

    def by_band(self) -> tuple[Float[Tensor, "m k"], ...]:
        """The splats that may reach each band."""
        return self.banded.rows.split(list(self.banded.counts))


@dataclass(frozen=True)
class Band:
    """A band that this process renders."""

    number: int
    """Its number among the bands of all images."""
    counts: tuple[int, ...]
    """Number of its splats from each process."""
    rendered: RenderedBand


class Views:
    """The images of one render by all processes."""

    def __init__(
        self,
        group: Group,
        division: Division,
        model: PrimitiveModel,
        rasterizer: Rasterizer,
        cameras: Cameras,
        settings: RenderSettings,
        time: Float[Tensor, ""] | None,
        rows: int,
    ) -> None:
        """Render images.

        Args:
            group: the processes, which all make the same images.
            division: of rows and images.
            model: has the rows of this process.
            rasterizer: renders the bands.
            cameras: one per image.
            settings: settings of the render.
            time: capture time, as of ``PrimitiveModel.splats``.
            rows: number of rows of all processes.

        Raises:
            ConfigError: a statistic cannot be added up over bands.
        """
        self._group, self._division, self._cameras = group, division, cameras
        self._pixels = division.bands(cameras.height)
        numbers = range(len(cameras) * len(self._pixels))
        self._owners = [division.owner(*divmod(n, len(self._pixels))) for n in numbers]
        evaluated = list(self._evaluated(model, cameras, rows, time))
        self._images = _bands(rasterizer, evaluated[0][1], cameras, settings, self._pixels)
        self.shards = [
            Shard(window, splats, self._images.project(splats)) for window, splats in evaluated
        ]
        self.bands = self._rendered()
        self._whole = self._gathered()
        self.output = self._images.output(*self._whole)

    @property
    def learns_poses(self) -> bool:
        """True if the poses of the cameras take gradients."""
        return self._cameras.world_to_camera.requires_grad

    # Forward.

    def _evaluated(
        self, model: PrimitiveModel, cameras: Cameras, rows: int, time: Float[Tensor, ""] | None
    ) -> list[tuple[Window, Splats]]:
        """Evaluate the model for the rows of each shard of this process."""
        division, rank, found = self._division, self._group.rank, []
        first = division.rows_of(rank, rows).start
        for number in division.shards_of(rank):
            ends = (division.start(number + step, rows) - first for step in (0, 1))
            window = Window(model, *ends)
            with window.shown():
                found.append((window, splats_to_render(model, time, cameras)))
        return found

    def _bands_of(self, rank: int) -> list[int]:
        """The numbers of the bands of a process."""
        return [number for number, owner in enumerate(self._owners) if owner == rank]

    def _rendered(self) -> list[Band]:
        """Exchange splats, and render the bands of this process."""
        group, ranks = self._group, range(self._group.size)
        by_shard = torch.tensor([shard.banded.counts for shard in self.shards])
        table: list[list[int]] = group.all_gather(by_shard.sum(0).to(group.device)).tolist()
        shards = [shard.by_band() for shard in self.shards]
        sent = [
            [shard[band] for band in self._bands_of(rank) for shard in shards] for rank in ranks
        ]
        own, like = self._bands_of(group.rank), self.shards[0].banded.rows
        counts = {band: tuple(line[band] for line in table) for band in own}
        found = {band: like.new_empty(sum(counts[band]), like.shape[1]) for band in own}
        rooms = [list(found[band].split(counts[band])) for band in own]
        group.exchange_into(sent, [[room[rank] for room in rooms] for rank in ranks])
        del shards, sent, rooms
        for shard in self.shards:
            shard.banded.rows = like[:0].clone()  # They are not read again.
        del like
        return [self._band(band, counts[band], found.pop(band)) for band in own]

    def _band(self, number: int, counts: tuple[int, ...], rows: Float[Tensor, "m k"]) -> Band:
        try:
            rendered = self._images.render(number, rows)
        except ConfigError as error:  # Other processes do not find it in their bands.
            message = f"band {number} of the step: {error.message}"
            raise UserError(message, error.advice) from error
        return Band(number, counts, rendered)

    def _gathered(self) -> tuple[Tensor, Tensor]:
        """All channels and alpha of whole images, in every process; they take gradients."""
        group, cameras, like = self._group, self._cameras, self.shards[0].banded.rows
        shape = (len(cameras), cameras.height, cameras.width)
        image = like.new_empty(*shape, self._images.channels)
        alpha = like.new_empty(*shape, 1)
        own = [(band.rendered.image, band.rendered.alpha) for band in self.bands]
        rooms = [
            [self._part(whole, band) for band in self._bands_of(rank) for whole in (image, alpha)]
            for rank in range(group.size)
        ]
        group.share_into([part.flatten() for band in own for part in band], rooms)
        wanted = torch.is_grad_enabled()
        return image.requires_grad_(wanted), alpha.requires_grad_(wanted)

    def _part(self, whole: Float[Tensor, "c h w d"], band: int) -> Float[Tensor, " k"]:
        """The values of a band in whole images, one after another; shares memory."""
        image, number = divmod(band, len(self._pixels))
        return whole[image, self._pixels[number].start : self._pixels[number].stop].view(-1)

    # Backward.

    def back(self) -> None:
        """Go back from the gradients of whole images to sums for the splats of each shard."""
        group, ranks = self._group, range(self._group.size)
        lines = [self._sums(band).split(list(band.counts)) for band in self.bands]
        sent = [[line[rank] for line in lines] for rank in ranks]
        banded = [shard.banded for shard in self.shards]
        self._returned = [item.rows.new_empty(sum(item.counts), item.num_sums) for item in banded]
        pairs = zip(self._returned, banded, strict=True)
        by_shard = [sums.split(list(item.counts)) for sums, item in pairs]
        # From each process, band after band as the splats were sent, and shard after shard of each.
        rooms = [
            [sums[band] for band in self._bands_of(rank) for sums in by_shard] for rank in ranks
        ]
        group.exchange_into(sent, rooms)

    def _sums(self, band: Band) -> Float[Tensor, "m s"]:
        """Sums for each splat of a band, from the gradient of its image."""
        image, number = divmod(band.number, len(self._pixels))
        rows = slice(self._pixels[number].start, self._pixels[number].stop)
        by_image, by_alpha = (whole.grad for whole in self._whole)
        return band.rendered.sums(
            None if by_image is None else by_image[image, rows],
            None if by_alpha is None else by_alpha[image, rows, :, 0],
        )

    def shard_gradient(self, place: int) -> tuple[Tensor, Tensor]:
        """A tensor in the graph of a shard, and its gradient, after ``back``."""
        return self.shards[place].banded.gradient(self._returned[place])

    def statistics(self) -> RenderStatistics:
        """The statistics of all rows of this process, after the backward passes of all shards."""
        return RenderStatistics.joined_rows(
            [
                shard.banded.statistics(sums).map(partial(_by_row, shard))
                for shard, sums in zip(self.shards, self._returned, strict=True)
            ]
        )


def _bands(
    rasterizer: Rasterizer,
    splats: Splats,
    cameras: Cameras,
    settings: RenderSettings,
    pixels: Sequence[range],
) -> Bands:
    """The bands of images, by kernels for them where the rasterizer has some."""
    found = rasterizer.bands(splats, cameras, settings, pixels)
    return found or FlatBands(rasterizer, splats, cameras, settings, pixels)


def _by_row(shard: Shard, values: Tensor) -> Tensor:
    """Values of splats, for all rows of their shard."""
    if shard.splats.rows is None:
        return values
    zeros = values.new_zeros(len(values), shard.window.count)
    return zeros.index_copy(1, shard.splats.rows, values)
