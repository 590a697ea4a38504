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
from gsfw.core.errors import ConfigError, TrainingError
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import RenderSettings
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
        self._sent = [sum(counts) for counts in zip(*self._counts(), strict=True)]
        """Splats that this process sends to each band."""
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
                found.append((window, model.splats(time, cameras)))
        return found

    def _counts(self) -> list[tuple[int, ...]]:
        """For each shard: its splats that may reach each band."""
        return [shard.banded.counts for shard in self.shards]

    def _bands_of(self, rank: int) -> list[int]:
        """The numbers of the bands of a process."""
        return [number for number, owner in enumerate(self._owners) if owner == rank]

    def _by_rank(self) -> list[int]:
        """The numbers of all bands, those of the first process first."""
        return [band for rank in range(self._group.size) for band in self._bands_of(rank)]

    def _rendered(self) -> list[Band]:
        """Exchange splats, and render the bands of this process."""
        group = self._group
        sent_to_bands = torch.tensor(self._sent, device=group.device)
        table: list[list[int]] = group.all_gather(sent_to_bands).tolist()
        shards = [shard.by_band() for shard in self.shards]
        sent = torch.cat([shard[band] for band in self._by_rank() for shard in shards])
        own = self._bands_of(group.rank)
        received = [[line[band] for band in own] for line in table]
        found = group.exchange_rows(sent, self._sent_by_rank(), list(map(sum, received)))
        parts = [rows.split(line) for rows, line in zip(found, received, strict=True)]
        return [self._band(band, rows) for band, *rows in zip(own, *parts, strict=True)]

    def _sent_by_rank(self) -> list[int]:
        """Splats that this process sends to each process, for all bands of it."""
        ranks = range(self._group.size)
        return [sum(self._sent[band] for band in self._bands_of(rank)) for rank in ranks]

    def _band(self, number: int, received: Sequence[Tensor]) -> Band:
        rows = received[0] if len(received) == 1 else torch.cat(list(received))
        try:
            rendered = self._images.render(number, rows)
        except ConfigError as error:  # Other processes do not find it in their bands.
            raise TrainingError(
                f"band {number} of the step: {error.message}", error.advice
            ) from error
        return Band(number, tuple(map(len, received)), rendered)

    def _gathered(self) -> tuple[Tensor, Tensor]:
        """All channels and alpha of whole images, in every process; they take gradients."""
        group, channels, cameras = self._group, self._images.channels, self._cameras
        like, step = self.shards[0].banded.rows, len(self._pixels[0])
        most = max(len(self._bands_of(rank)) for rank in range(group.size))
        own = like.new_zeros(most, step, cameras.width, channels + 1)
        for place, band in enumerate(self.bands):
            height = len(band.rendered.alpha)
            own[place, :height, :, :channels] = band.rendered.image
            own[place, :height, :, channels] = band.rendered.alpha
        places = {
            band: rank * most + place
            for rank in range(group.size)
            for place, band in enumerate(self._bands_of(rank))
        }
        order = torch.tensor([places[band] for band in range(len(places))], device=own.device)
        bands = group.all_gather(own).flatten(0, 1).index_select(0, order)
        whole = bands.unflatten(0, (len(cameras), len(self._pixels))).flatten(1, 2)
        parts = whole[:, : cameras.height].split([channels, 1], dim=-1)
        wanted = torch.is_grad_enabled()
        image, alpha = (part.contiguous().requires_grad_(wanted) for part in parts)
        return image, alpha

    # Backward.

    def back(self) -> None:
        """Go back from the gradients of whole images to sums for the splats of each shard."""
        group, width = self._group, self.shards[0].banded.num_sums
        ranks = range(group.size)
        lines = [self._sums(band).split(list(band.counts)) for band in self.bands]
        nothing = self.shards[0].banded.rows.new_zeros(0, width)
        returned = torch.cat([nothing] + [line[rank] for rank in ranks for line in lines])
        counts = [sum(band.counts[rank] for band in self.bands) for rank in ranks]
        found = torch.cat(group.exchange_rows(returned, counts, self._sent_by_rank()))
        # Band after band as they were sent, and shard after shard of each.
        order, by_shard = self._by_rank(), self._counts()
        parts = found.split([counts[band] for band in order for counts in by_shard])
        places = {band: place * len(by_shard) for place, band in enumerate(order)}
        self._returned = [
            torch.cat([parts[places[band] + number] for band in range(len(order))])
            for number in range(len(by_shard))
        ]

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
