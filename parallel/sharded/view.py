"""View: one image that all processes render together, and its backward pass.

Forward: every process projects its rows, shard by shard, and sends the flat splats to the processes
whose bands they reach; each renders its bands, and sends them to all. Backward: each process has
the gradient of the whole image, goes back through its bands, and returns the gradients of flat
splats to the processes that sent them. They are added in the order of the bands.

Per image and process that is, of m flat splats with k values that reach b bands each, and N
processes, up to a splat in the last band,

    4 (k + 2) m b (N - 1) / N^2 bytes backward, 4 k of them forward, and the image itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Splats
from gsfw.parallel.group import Group
from gsfw.parallel.sharded.division import Division
from gsfw.parallel.sharded.projection import SHAPE, FlatSplats, band_camera, drawn, project
from gsfw.parallel.sharded.window import Window

GRADIENTS = frozenset({Statistic.SCREEN_GRADIENT})
"""Statistics that follow from the gradients of flat splats; bands need not measure them."""


@dataclass(frozen=True)
class Shard:
    """The rows of one shard of the model in a view."""

    window: Window
    splats: Splats
    flat: FlatSplats
    sent: tuple[Int[Tensor, " r"], ...]
    """For each band, the flat splats that may reach it."""


@dataclass(frozen=True)
class Band:
    """A band of an image that this process renders."""

    number: int
    pixels: range
    splats: Float[Tensor, "m k"]
    """Flat splats of all processes that may reach it, without a graph; they get gradients."""
    counts: tuple[int, ...]
    """Number of them from each process."""
    output: RenderOutput


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
        if Statistic.ABSGRAD in settings.statistics:
            raise ConfigError(
                f"shards={division.shards}: absolute gradients (strategy.absgrad=true) are sums "
                "over a whole image, and processes render bands of it.",
                "Train with strategy.absgrad=false, or with shards=0.",
            )
        self._group, self._division, self._camera, self.settings = group, division, camera, settings
        self._bands_pixels = division.bands(camera.height)
        self._first_row = division.rows_of(group.rank, rows).start
        self.shards = [self._shard(model, number, rows, time) for number in self._numbers()]
        first = self.shards[0].splats
        self._channels = first.channels
        self._extras = 0 if first.extra is None else first.extra.shape[1]
        self.bands = self._rendered(rasterizer)
        self.output = self._gathered()

    def _numbers(self) -> range:
        return self._division.shards_of(self._group.rank)

    # Forward.

    def _shard(
        self, model: PrimitiveModel, number: int, rows: int, time: Float[Tensor, ""] | None
    ) -> Shard:
        """Evaluate the model and project its splats, for the rows of one shard."""
        division = self._division
        start = division.start(number, rows) - self._first_row
        window = Window(model, start, division.start(number + 1, rows) - self._first_row)
        with window.shown():
            splats = model.splats(time, self._camera)
        flat = project(splats, self._camera, self.settings)
        return Shard(
            window, splats, flat, tuple(flat.reaching(band) for band in self._bands_pixels)
        )

    def _rendered(self, rasterizer: Rasterizer) -> list[Band]:
        """Exchange flat splats, and render the bands of this process."""
        group = self._group
        counts = torch.tensor(
            [sum(len(shard.sent[b]) for shard in self.shards) for b in self._all()]
        )
        table: list[list[int]] = group.all_gather(counts.to(group.device)).tolist()
        sent = [
            torch.cat([self._outgoing(band) for band in self._bands_of(rank)])
            if self._bands_of(rank)
            else self._nothing()
            for rank in range(group.size)
        ]
        own = self._bands_of(group.rank)
        found = group.exchange_rows(sent, [sum(line[b] for b in own) for line in table])
        by_rank = [
            rows.split([line[b] for b in own]) for rows, line in zip(found, table, strict=True)
        ]
        return [
            self._band(rasterizer, band, [bands[place] for bands in by_rank])
            for place, band in enumerate(own)
        ]

    def _all(self) -> range:
        return range(len(self._bands_pixels))

    def _bands_of(self, rank: int) -> list[int]:
        return self._division.bands_of(rank, self._camera.height)

    def _outgoing(self, band: int) -> Float[Tensor, "m k"]:
        """The flat splats of this process that may reach a band, shard by shard."""
        return torch.cat(
            [shard.flat.values.detach().index_select(0, shard.sent[band]) for shard in self.shards]
        )

    def _nothing(self) -> Float[Tensor, "0 k"]:
        return self.shards[0].flat.values.detach()[:0]

    def _band(self, rasterizer: Rasterizer, number: int, received: Sequence[Tensor]) -> Band:
        pixels, settings = self._bands_pixels[number], self.settings
        splats = torch.cat(list(received)).requires_grad_(torch.is_grad_enabled())
        weights = settings.contribution_weights
        output = rasterizer.render(
            drawn(splats, self._channels),
            band_camera(self._camera, pixels),
            replace(
                settings,
                statistics=settings.statistics - GRADIENTS,
                contribution_weights=None
                if weights is None
                else weights[:, pixels.start : pixels.stop].contiguous(),
            ),
        )
        return Band(number, pixels, splats, tuple(map(len, received)), output)

    def _images(self, output: RenderOutput) -> list[Tensor]:
        """The images of a render, in one order."""
        images = [output.color, output.alpha, output.depth, output.extra]
        return [image for image in images if image is not None]

    def _gathered(self) -> RenderOutput:
        """The whole image in every process; it gets gradients, and has no graph."""
        most = len(self._division.bands_of(0, self._camera.height))
        step = self._division.band_height(self._camera.height)
        widths = [self._channels, 1, int(self.settings.depth is not Depth.NONE), self._extras]
        like = self._nothing()
        own = like.new_zeros(most, step, self._camera.width, sum(widths))
        for place, band in enumerate(self.bands):
            joined = torch.cat([image.detach()[0] for image in self._images(band.output)], dim=-1)
            own[place, : len(band.pixels)] = joined
        found = self._group.all_gather(own)
        whole = torch.cat(
            [
                found[band % self._group.size, band // self._group.size, : len(pixels)]
                for band, pixels in enumerate(self._bands_pixels)
            ]
        )[None]
        color, alpha, depth, extra = [
            image.contiguous().requires_grad_(torch.is_grad_enabled())
            for image in whole.split(widths, dim=-1)
        ]
        return RenderOutput(
            color=color,
            alpha=alpha,
            statistics=RenderStatistics.zeros(like[:, :3], 1, frozenset()),
            depth=depth if widths[2] else None,
            extra=extra if widths[3] else None,
        )

    # Backward.

    def back(self) -> list[RenderStatistics]:
        """Go back from the gradient of the whole image to the splats of each shard.

        Returns:
            The statistics of the rows of each shard, whose graph waits for ``shard_gradients``.
        """
        self._gradients = self._returned()
        return [self._statistics(place) for place in range(len(self.shards))]

    def _returned(self) -> list[list[Tensor]]:
        """For each band and shard: the gradients of flat splats, and what the band has measured."""
        group = self._group
        lines = [self._measured(band) for band in self.bands]
        sent = [
            torch.cat(
                [self._nothing_measured()]
                + [
                    line.split(list(band.counts))[rank]
                    for line, band in zip(lines, self.bands, strict=True)
                ]
            )
            for rank in range(group.size)
        ]
        counts = [
            [sum(len(shard.sent[band]) for shard in self.shards) for band in self._bands_of(rank)]
            for rank in range(group.size)
        ]
        found = group.exchange_rows(sent, [sum(line) for line in counts])
        by_rank = [rows.split(line) for rows, line in zip(found, counts, strict=True)]
        return [
            list(
                by_rank[band % group.size][band // group.size].split(
                    [len(shard.sent[band]) for shard in self.shards]
                )
            )
            for band in self._all()
        ]

    def _nothing_measured(self) -> Float[Tensor, "0 k"]:
        width = SHAPE + self._channels + self._extras + 2 + self._contributes
        return self._nothing().new_zeros(0, width)

    @property
    def _contributes(self) -> bool:
        return Statistic.CONTRIBUTION in self.settings.statistics

    def _measured(self, band: Band) -> Float[Tensor, "m k"]:
        """Gradients of the flat splats of a band, their visibility, radii and contributions."""
        images = self._images(band.output)
        wholes = self._images(self.output)
        rows = slice(band.pixels.start, band.pixels.stop)
        pairs = [
            (image, whole.grad[:, rows].contiguous())
            for image, whole in zip(images, wholes, strict=True)
            if whole.grad is not None and image.requires_grad
        ]
        if pairs:
            torch.autograd.backward([one for one, _ in pairs], [gradient for _, gradient in pairs])
        gradient = band.splats.grad
        if gradient is None:
            gradient = torch.zeros_like(band.splats)
        seen = band.output.statistics
        measured = [gradient, seen.visible.T.to(gradient), seen.radii.T.to(gradient)]
        if self._contributes:
            assert seen.contribution is not None
            measured.append(seen.contribution.T.to(gradient))
        return torch.cat(measured, dim=1)

    def shard_gradients(self, place: int) -> Float[Tensor, "m k"]:
        """The gradients of the flat splats of a shard; bands are added in their order."""
        shard, width = self.shards[place], self.shards[place].flat.values.shape[1]
        total = torch.zeros_like(shard.flat.values)
        for rows, found in zip(shard.sent, self._gradients, strict=True):
            total.index_add_(0, rows, found[place][:, :width])
        return total

    def _statistics(self, place: int) -> RenderStatistics:
        """The statistics of all rows of a shard."""
        shard, width = self.shards[place], self.shards[place].flat.values.shape[1]
        flat = RenderStatistics.zeros(shard.flat.values, 1, self.settings.statistics)
        for rows, found in zip(shard.sent, self._gradients, strict=True):
            visible, radii = found[place][:, width : width + 2].unbind(1)
            flat.visible[0, rows] |= visible > 0
            flat.radii[0, rows] = torch.maximum(flat.radii[0, rows], radii)
            if flat.contribution is not None:
                flat.contribution[0].index_add_(0, rows, found[place][:, width + 2])
        if flat.screen_gradient is not None:
            half = 0.5 * flat.radii.new_tensor([self._camera.width, self._camera.height])
            flat.screen_gradient[0] = (self.shard_gradients(place)[:, :2] * half).norm(dim=1)
        return flat.map(lambda values: self._by_row(shard, values))

    @staticmethod
    def _by_row(shard: Shard, values: Tensor) -> Tensor:
        """Values of flat splats, for all rows of their shard."""
        rows = shard.flat.rows if shard.splats.rows is None else shard.splats.rows[shard.flat.rows]
        return values.new_zeros(1, shard.window.count).index_copy(1, rows, values)
