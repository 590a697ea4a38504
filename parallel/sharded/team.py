"""Gaussian parallel: processes share the rows of a model, and the bands of every image.

Zhao et al. 2024 (On Scaling Up 3D Gaussian Splatting Training, Grendel-GS) divide rows, exchange
projected Gaussians, and divide images. Every process renders its part of every view (``views``) and
then has the whole image: losses, decoders and decisions are computed by all alike, so that methods
and strategies need no change. A process has the rows, gradients and moments of its shards alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool, Float, Int, Shaped
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.column import Layout, Rows
from gsfw.core.context import StepContext
from gsfw.core.errors import ConfigError
from gsfw.core.files.mapped import mapped_tensor
from gsfw.core.loop.forward import Absent, RenderedBatch
from gsfw.core.loop.memory import release_freed_memory
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.model import DensifiableModel, PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import RenderSettings
from gsfw.core.table import SplatTable
from gsfw.core.team import ALONE, Observation, RenderedPart, Rendering
from gsfw.parallel.group import Group
from gsfw.parallel.parallel_team import ParallelTeam
from gsfw.parallel.sharded.division import Division
from gsfw.parallel.sharded.state import by_row, num_rows, rows_of, whole
from gsfw.parallel.sharded.views import Views

STATISTICS = tuple(item.name for item in fields(RenderStatistics))
Gradients = list[tuple[Tensor, Tensor | None]]
"""Tensors, with the gradients that they had."""


class GaussianParallel(ParallelTeam):
    """The rows of the model and the bands of images are divided among processes."""

    splits_views = False

    def __init__(self, group: Group, shards: int) -> None:
        """Start before the first step.

        Args:
            group: the processes.
            shards: of rows and images; at least as many as processes.
        """
        super().__init__(group)
        self.num_rows = 0
        """Rows of all processes."""
        self.division = Division(shards, group.size)
        self._open: list[Views] = []
        self._statistics: list[RenderStatistics] = []

    def check(self, parts: TrainingParts) -> None:
        """Refuse parts that need all rows, or more of the images than their pixels."""
        super().check(parts)
        if self.size > self.division.shards:
            raise ConfigError(
                f"shards={self.division.shards} cannot be divided among {self.size} processes.",
                f"Train with processes={self.division.shards} at most, or with shards={self.size} "
                "in a new run.",
            )
        refused = [_why_not(parts)] + [
            f"{type(refiner).__name__} ({refiner.name}) reads the columns of the model"
            for refiner in parts.refiners
            if not refiner.divisible
        ]
        for reason in filter(None, refused):
            raise ConfigError(
                f"shards={self.division.shards}: {reason}.",
                "Train with shards=0, where every process has all Gaussians and renders its own "
                "views, or with another method or strategy.",
            )

    def share(self, parts: TrainingParts) -> TrainingParts:
        """The same parts with the rows of this process alone."""
        from gsfw.parallel.sharded.rows import ShardedRows
        from gsfw.parallel.sharded.table import ShardedTable

        self.num_rows = len(parts.table)
        own = self.own_rows
        rows, model = torch.arange(own.start, own.stop, device=parts.device), parts.model
        for name, column in model.columns().items():
            column.assign(column.take(rows))
            parts.optimizer.reset([name])
        release_freed_memory()  # That of all rows.
        return replace(
            parts,
            team=self,
            table=ShardedTable(model, parts.optimizer, self),
            edited=ShardedRows(model, self) if isinstance(model, DensifiableModel) else None,
        )

    # Rows.

    @property
    def own_rows(self) -> range:
        """The rows of this process, among all."""
        return self.division.rows_of(self.rank, self.num_rows)

    @property
    def counts(self) -> list[int]:
        """Number of rows of each process."""
        return [len(self.division.rows_of(rank, self.num_rows)) for rank in range(self.size)]

    def all_rows(self, values: Shaped[Tensor, "own ..."]) -> Shaped[Tensor, "n ..."]:
        """The values of all rows, from those of this process."""
        return self._group.all_gather_rows(values, self.counts)

    def to_first(
        self, values: Shaped[Tensor, "own ..."], folder: Path
    ) -> Shaped[Tensor, "n ..."] | None:
        """The values of all rows, in the first process; ``None`` in the others.

        One process sends at a time, and the whole is a file: the first process, too, needs no
        memory for rows of others than for those of one of them.
        """
        whole, parts, ranks = None, None, range(self.size)
        if self.leads:
            whole = mapped_tensor(folder, (self.num_rows, *values.shape[1:]), values.dtype)
            parts = whole.split(self.counts)
        nothing, own = values[:0], values.contiguous()
        for sender in ranks:
            sent = [[own if sender == self.rank and rank == 0 else nothing] for rank in ranks]
            rooms = [[parts[rank] if parts and rank == sender else nothing] for rank in ranks]
            self._group.exchange_into(sent, rooms)
        return whole

    def deliver(self, rows: Mapping[str, Tensor], owners: Int[Tensor, " r"]) -> dict[str, Tensor]:
        """Bring rows to the processes that shall have them; those from the first process first.

        Args:
            rows: tensors [r, ...], by name.
            owners: rank of the new owner of each row.
        """
        order = owners.argsort(stable=True)
        sent = owners.bincount(minlength=self.size)
        received = self._group.all_gather(sent)[:, self.rank].tolist()
        found = {}
        for name, values in rows.items():
            parts = values.index_select(0, order).split(sent.tolist())
            found[name] = values.new_empty(sum(received), *values.shape[1:])
            rooms = found[name].split(received)
            self._group.exchange_into([[part] for part in parts], [[room] for room in rooms])
        return found

    # Rendering.

    def render(
        self,
        model: PrimitiveModel,
        rasterizer: Rasterizer,
        cameras: Cameras,
        settings: RenderSettings,
        time: Float[Tensor, ""] | None,
    ) -> Rendering:
        """Render images with all processes; every process gets them."""
        views = Views(
            self._group, self.division, model, rasterizer, cameras, settings, time, self.num_rows
        )
        if torch.is_grad_enabled():
            self._open.append(views)
        nowhere, total = views.output.statistics, max(self.num_rows, 1)
        parts = [
            RenderedPart(shard.splats, nowhere, shard.window.count / total, shard.window.shown)
            for shard in views.shards
        ]
        absent: Any = Absent(rows=None)
        return Rendering(views.output, absent, parts)

    def backward(self, rendered: RenderedBatch | None, optimizer: Optimizer) -> None:
        """Go back from the losses to the rows of this process, shard by shard."""
        assert rendered is not None
        share, tensors = rendered.context.share, optimizer.group_tensors()
        before = _taken(tensors)
        data = [rendered.losses[name] for name in rendered.data_losses]
        (torch.stack(data).sum() * share).backward()
        of_images = _taken(tensors)
        for view in self._open:
            view.back()
        of_shards = []
        for place, terms in enumerate(rendered.by_rows):
            self._shard_backward(place, list(terms.values()), share)
            if tensors:
                of_shards.append(_flat(_taken(tensors)))
        self._statistics.append(self._open[0].statistics())
        self._open.clear()
        if tensors:
            self._add_up(before, of_images, torch.stack(of_shards))

    def _shard_backward(self, place: int, terms: list[Tensor], share: float) -> None:
        """The backward pass of one shard of the rows, in all renders of the batch."""
        pairs = [view.shard_gradient(place) for view in self._open]
        roots, gradients = map(list, zip(*pairs, strict=True))
        terms = [term for term in terms if term.requires_grad]
        if terms:
            roots.append(torch.stack(terms).sum())
            gradients.append(roots[-1].new_tensor(share))
        # Poses that are refined are part of the graphs of all shards.
        last = place + 1 == len(self.division.shards_of(self.rank))
        torch.autograd.backward(roots, gradients, retain_graph=not last and self._poses_learned)
        for view in self._open:
            view.shards[place].window.add_gradients()

    @property
    def _poses_learned(self) -> bool:
        return any(views.learns_poses for views in self._open)

    def _add_up(
        self,
        before: Gradients,
        of_images: Gradients,
        of_shards: Float[Tensor, "shards k"],
    ) -> None:
        """Add up the gradients of tensors without rows: images first, then shards in order.

        Every process has the whole gradient by the images, and that by its own rows.
        """
        counts = [len(self.division.shards_of(rank)) for rank in range(self.size)]
        total = _flat(of_images)
        for of_shard in self._group.all_gather_rows(of_shards, counts):
            total += of_shard
        start, sizes = 0, [tensor.numel() for tensor, _ in before]
        present = total[sum(sizes) :] > 0
        for (tensor, earlier), size, has in zip(before, sizes, present, strict=True):
            if has:
                found = total[start : start + size].view_as(tensor)
                tensor.grad = found.clone() if earlier is None else earlier + found
            start += size

    def _of_all_rows(self, own: Sequence[RenderStatistics]) -> list[RenderStatistics]:
        """Exchange statistics, so that each render of a step has those of all rows.

        Only rows that a view has seen are sent: bytes do not grow with the scene.
        """
        views = [len(statistics.visible) for statistics in own]
        joined = RenderStatistics.cat(own)
        names = [n for n in STATISTICS if n != "visible" and getattr(joined, n) is not None]
        # Seen rows, view after view, with their numbers among those of this process.
        view, row = joined.visible.nonzero(as_tuple=True)
        columns = [getattr(joined, name)[view, row].float() for name in names]
        lines = torch.stack([row.int().view(torch.float32), *columns], dim=1)
        counts = self._group.all_gather(view.bincount(minlength=len(joined.visible)))
        found = self._group.all_gather_rows(lines, counts.sum(1).tolist())
        starts = torch.arange(sum(views), device=row.device) * self.num_rows
        firsts = [self.division.rows_of(rank, self.num_rows).start for rank in range(self.size)]
        offsets = torch.tensor(firsts, device=row.device)[:, None] + starts
        rows = found[:, 0].contiguous().view(torch.int32).long()
        rows += offsets.flatten().repeat_interleave(counts.flatten())
        shape = (sum(views), self.num_rows)
        visible = torch.zeros(shape, dtype=torch.bool, device=row.device)
        visible.view(-1).index_fill_(0, rows, True)
        values = {name: lines.new_zeros(shape) for name in names}
        for name, column in zip(names, found[:, 1:].T, strict=True):
            values[name].view(-1).index_copy_(0, rows, column.contiguous())
        return RenderStatistics(visible=visible, **values).split(views)

    def finish(self, rendered: Sequence[RenderedBatch], optimizer: Optimizer) -> list[Tensor]:
        """The losses of all batches."""
        return [item.total.detach() for item in rendered]

    def agreed(self, finite: Bool[Tensor, ""]) -> Bool[Tensor, ""]:
        """True if it is so in all processes, whose rows are others."""
        return self._group.all_gather(finite.to(torch.uint8)).bool().all()

    # After the optimizer step.

    def observations(
        self,
        rendered: Sequence[RenderedBatch],
        refiners: Refiners,
        absent: Callable[[int], StepContext],
    ) -> Iterator[Observation]:
        """All batches, with the statistics of all rows if a refiner gathers them."""
        of_all = self._statistics
        if self.size > 1 and refiners.observes:
            of_all = self._of_all_rows(of_all)
        for item, statistics in zip(rendered, of_all, strict=True):
            context = replace(item.context, splats=absent(item.context.batch.views[0]).splats)
            yield Observation(context, statistics, item.data_loss.detach())
        self._statistics.clear()

    @property
    def shares_rendering(self) -> bool:
        """True for several processes: none of them has all rows."""
        return self.size > 1

    def meets_again(self, standing: object) -> bool:
        """Compare standings by the spare connections, which collect the state from now on."""
        spare = self._group.spare()
        if spare is None:
            return False
        self._group = spare
        found = self.gathered(standing)
        return standing is not None and found.count(standing) == self.size

    def whole(
        self, state: dict[str, Any], parts: TrainingParts, folder: Path
    ) -> dict[str, Any] | None:
        """The state with all rows, in the first process."""
        found = whole(state, parts.model, partial(self.to_first, folder=folder))
        return found if self.leads else None

    def own_state(self, state: Mapping[str, Any], parts: TrainingParts) -> Mapping[str, Any]:
        """The state with the rows of this process."""
        self.num_rows = num_rows(state, parts.model)
        return rows_of(state, parts.model, self.own_rows)

    def reunited(self, parts: TrainingParts, folder: Path) -> TrainingParts:
        """The same with all rows in the first process, which trains no more.

        Its optimizer keeps the moments of its own rows: their bytes are those of training.
        """
        for column in parts.model.columns().values():
            found = self.to_first(by_row(column, column.values.detach()), folder)
            if found is not None:
                column.assign(Rows(by_row(column, found).to(parts.device)))
        release_freed_memory()  # That of training: rendering and writing all rows needs other.
        if not self.leads:
            return parts
        table = SplatTable(parts.model, parts.optimizer)
        return replace(parts, team=ALONE, table=table, edited=None)


def _why_not(parts: TrainingParts) -> str:
    """The cause why a run cannot be divided by rows; empty if it can."""
    columns = parts.model.columns()
    ragged = [name for name, column in columns.items() if column.layout is Layout.RAGGED]
    if not parts.model.divisible:
        return f"rows of {type(parts.model).__name__} depend on other rows"
    if ragged:
        return f"the column {ragged[0]!r} has rows of different lengths"
    if parts.rendered is not None:
        return "a model with rounded columns is rendered whole"
    if parts.optimizer.sparse:
        return "optim.sparse=true needs the rows that any view has seen"
    if CameraModel.ORTHOGRAPHIC not in parts.rasterizer.capabilities().camera_models:
        return f"{type(parts.rasterizer).__name__} has no orthographic cameras"
    return ""


def _taken(tensors: Sequence[Tensor]) -> Gradients:
    """Take the gradients away from tensors."""
    found = [tensor.grad for tensor in tensors]
    for tensor in tensors:
        tensor.grad = None
    return [*zip(tensors, found, strict=True)]


def _flat(gradients: Gradients) -> Float[Tensor, " k"]:
    """Gradients one after another, 0 for those that are absent, then 1 for those that are there."""
    values = [torch.zeros_like(t) if g is None else g for t, g in gradients]
    present = values[0].new_tensor([float(g is not None) for _, g in gradients])
    return torch.cat([*(value.flatten() for value in values), present])
