"""View: one image that all processes render together, and its backward pass.

Forward: every process projects its rows, shard by shard, and sends the splats to the processes
whose bands they reach; each renders its bands, and sends them to all. Backward: every process has
the gradient of the whole image, goes back through its bands, and returns sums for each splat to the
process that sent it. They are added in the order of the bands.

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
    """The rows of one shard of the model in a view."""

    window: Window
    splats: Splats
    banded: BandedSplats

    def sent_to(self, band: int) -> Float[Tensor, "m k"]:
        """The splats that may reach a band."""
        start = sum(self.banded.counts[:band])
        return self.banded.rows[start : start + self.banded.counts[band]]


@dataclass(frozen=True)
class Band:
    """A band of the image that this process renders."""

    pixels: range
    counts: tuple[int, ...]
    """Number of its splats from each process."""
    rendered: RenderedBand


class View:
    """One image of all processes."""

    def __init__(
        self,
        group: Group,
        division: Division,
        model: PrimitiveModel,
        rasterizer: Rasterizer,
        camera: Cameras,
        settings: RenderSettings,
        time: Float[Tensor, ""] | None,
        rows: int,
    ) -> None:
        """Render an image.

        Args:
            group: the processes, which all make the same view.
            division: of rows and images.
            model: has the rows of this process.
            rasterizer: renders the bands.
            camera: one camera.
            settings: settings of the render.
            time: capture time, as of ``PrimitiveModel.splats``.
            rows: number of rows of all processes.

        Raises:
            ConfigError: a statistic cannot be added up over bands.
        """
        self._group, self._division, self._height = group, division, camera.height
        self._pixels = division.bands(camera.height)
        evaluated = list(self._evaluated(model, camera, rows, time))
        like = evaluated[0][1]
        self._image = _image(rasterizer, like, camera, settings, self._pixels)
        self.shards = [
            Shard(window, splats, self._image.project(splats)) for window, splats in evaluated
        ]
        self.bands = self._rendered()
        self._pixel_values = self._gathered(camera.width)
        self.output = self._image.output(*self._pixel_values)

    # Forward.

    def _evaluated(
        self, model: PrimitiveModel, camera: Cameras, rows: int, time: Float[Tensor, ""] | None
    ) -> list[tuple[Window, Splats]]:
        """Evaluate the model for the rows of each shard of this process."""
        division, rank, found = self._division, self._group.rank, []
        first = division.rows_of(rank, rows).start
        for number in division.shards_of(rank):
            ends = (division.start(number + step, rows) - first for step in (0, 1))
            window = Window(model, *ends)
            with window.shown():
                found.append((window, model.splats(time, camera)))
        return found

    def _bands_of(self, rank: int) -> list[int]:
        return self._division.bands_of(rank, self._height)

    def _sent(self, band: int) -> int:
        """Splats that this process sends to a band."""
        return sum(shard.banded.counts[band] for shard in self.shards)

    def _sent_by_rank(self) -> list[list[int]]:
        """Splats that this process sends to each band of each process."""
        ranks = range(self._group.size)
        return [[self._sent(band) for band in self._bands_of(rank)] for rank in ranks]

    def _rendered(self) -> list[Band]:
        """Exchange splats, and render the bands of this process."""
        group = self._group
        counts = torch.tensor([self._sent(band) for band in range(len(self._pixels))])
        table: list[list[int]] = group.all_gather(counts.to(group.device)).tolist()
        places = [band for rank in range(group.size) for band in self._bands_of(rank)]
        sent = torch.cat([shard.sent_to(band) for band in places for shard in self.shards])
        own = self._bands_of(group.rank)
        received = [sum(line[b] for b in own) for line in table]
        found = group.exchange_rows(sent, list(map(sum, self._sent_by_rank())), received)
        by_rank = [
            rows.split([line[b] for b in own]) for rows, line in zip(found, table, strict=True)
        ]
        return [
            self._band(band, [bands[place] for bands in by_rank]) for place, band in enumerate(own)
        ]

    def _band(self, number: int, received: Sequence[Tensor]) -> Band:
        rows = received[0] if len(received) == 1 else torch.cat(list(received))
        rendered = self._image.render(number, rows)
        return Band(self._pixels[number], tuple(map(len, received)), rendered)

    def _gathered(self, width: int) -> tuple[Tensor, Tensor]:
        """All channels and alpha of the whole image, in every process; they take gradients."""
        group, channels, wanted = self._group, self._image.channels, torch.is_grad_enabled()
        like, step = self.shards[0].banded.rows, len(self._pixels[0])
        own = like.new_zeros(len(self._bands_of(0)), step, width, channels + 1)
        for place, band in enumerate(self.bands):
            own[place, : len(band.pixels), :, :channels] = band.rendered.image
            own[place, : len(band.pixels), :, channels] = band.rendered.alpha
        # A process has every N-th band.
        whole = group.all_gather(own).transpose(0, 1).flatten(0, 2)[None, : self._height]
        image, alpha = (part.contiguous() for part in whole.split([channels, 1], dim=-1))
        return image.requires_grad_(wanted), alpha.requires_grad_(wanted)

    # Backward.

    def back(self) -> None:
        """Go back from the gradient of the whole image to sums for the splats of each shard."""
        group, width = self._group, self.shards[0].banded.num_sums
        lines = [self._sums(band).split(list(band.counts)) for band in self.bands]
        nothing = self.shards[0].banded.rows.new_zeros(0, width)
        by_rank = [line[rank] for rank in range(group.size) for line in lines]
        counts = self._sent_by_rank()
        sent = [sum(band.counts[rank] for band in self.bands) for rank in range(group.size)]
        found = group.exchange_rows(
            torch.cat([nothing, *by_rank]), sent, [sum(line) for line in counts]
        )
        returned = [rows.split(line) for rows, line in zip(found, counts, strict=True)]
        by_band = [
            returned[band % group.size][band // group.size].split(
                [shard.banded.counts[band] for shard in self.shards]
            )
            for band in range(len(self._pixels))
        ]
        self._returned = [torch.cat(list(parts)) for parts in zip(*by_band, strict=True)]

    def _sums(self, band: Band) -> Float[Tensor, "m s"]:
        """Sums for each splat of a band, from the gradient of the image."""
        rows = slice(band.pixels.start, band.pixels.stop)
        by_image, by_alpha = (whole.grad for whole in self._pixel_values)
        return band.rendered.sums(
            None if by_image is None else by_image[0, rows],
            None if by_alpha is None else by_alpha[0, rows, :, 0],
        )

    def shard_gradient(self, place: int) -> tuple[Tensor, Tensor]:
        """A tensor in the graph of a shard, and its gradient, after ``back``."""
        return self.shards[place].banded.gradient(self._returned[place])

    def statistics(self) -> list[RenderStatistics]:
        """The statistics of all rows of each shard, after the backward passes of all."""
        return [
            shard.banded.statistics(sums).map(partial(_by_row, shard))
            for shard, sums in zip(self.shards, self._returned, strict=True)
        ]


def _image(
    rasterizer: Rasterizer,
    splats: Splats,
    camera: Cameras,
    settings: RenderSettings,
    pixels: Sequence[range],
) -> Bands:
    """The bands of an image, by kernels for them where the rasterizer has some."""
    found = rasterizer.bands(splats, camera, settings, pixels)
    return found or FlatBands(rasterizer, splats, camera, settings, pixels)


def _by_row(shard: Shard, values: Tensor) -> Tensor:
    """Values of splats, for all rows of their shard."""
    if shard.splats.rows is None:
        return values
    return values.new_zeros(1, shard.window.count).index_copy(1, shard.splats.rows, values)
