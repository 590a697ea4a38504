"""DataParallel: every process has the whole model, and renders other views of a step.

Sums have a fixed order, so that the number of processes changes no bit: each view is a batch of its
own, view i of a step belongs to process i mod N, and gradients are added in order of the views.
Every process adds up one part of the parameters (as in a reduce-scatter) and sends the sums to the
others. Per step and process that is, of P parameters, V views and N processes,

    4 P (N - 1) / N (ceil(V / N) + 1) bytes of gradients, sent and received.

Optimizer and refiners then do the same in every process. Refiners get the statistics of all views,
and images only if they read them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, replace
from functools import reduce
from itertools import pairwise

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.loop.device import moved
from gsfw.core.loop.forward import RenderedBatch
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.refiner import Refiner
from gsfw.core.render_output import RenderStatistics
from gsfw.core.team import Observation
from gsfw.parallel.group import Group
from gsfw.parallel.parallel_team import ParallelTeam

STATISTICS = tuple(item.name for item in fields(RenderStatistics))


class DataParallel(ParallelTeam):
    """The views of a step are divided among processes."""

    def __init__(self, group: Group) -> None:
        """Start the first step of the processes of a group."""
        super().__init__(group)
        self._views: tuple[int, ...] = ()
        self._in_round = 0
        self._sums: Tensor | None = None
        self._data_losses: list[Tensor] = []
        self._measured: list[str] = []
        self._with_gradient: set[int] = set()

    # Rendering.

    def own(self, views: tuple[int, ...]) -> tuple[int, ...]:
        """Every N-th view."""
        self._views = views
        return views[self.rank :: self.size]

    def rounds(
        self, batches: Sequence[Batch], views: tuple[int, ...]
    ) -> Iterator[tuple[int, Batch | None]]:
        """One view per process and round."""
        self._sums = None
        for number, first in enumerate(range(0, len(views), self.size)):
            self._in_round = min(self.size, len(views) - first)
            yield first + self.rank, batches[number] if self.rank < self._in_round else None

    def backward(self, rendered: RenderedBatch | None, optimizer: Optimizer) -> None:
        """Add the gradients of the views of a round, in order; each process adds a part of them."""
        super().backward(rendered, optimizer)
        tensors = optimizer.tensors()
        for index, tensor in enumerate(tensors):
            if tensor.grad is not None:
                self._with_gradient.add(index)
        sent = _in_parts(tensors, self.size)
        parts = sent[0][0].new_empty(self.size, sum(map(len, sent[0])))
        self._group.exchange_into(sent, [[room] for room in parts])
        for part in parts[: self._in_round]:
            # A copy, or the parts of all processes would stay.
            self._sums = part.clone() if self._sums is None else self._sums.add_(part)
        optimizer.zero_gradients()

    def finish(self, rendered: Sequence[RenderedBatch], optimizer: Optimizer) -> list[Tensor]:
        """Gather the sums of gradients, and the losses of all views in order."""
        tensors = optimizer.tensors()
        assert self._sums is not None
        flat = self._group.all_gather(self._sums).flatten()
        facts = self._group.all_gather(self._facts(rendered, tensors))
        rounds = -(-len(self._views) // self.size)
        totals, data_losses, rest = facts.split_with_sizes(
            [rounds, rounds, facts.shape[1] - 2 * rounds], dim=1
        )
        present = rest.bool().any(0).tolist()
        self._measured = [n for n, seen in zip(STATISTICS, present, strict=False) if seen]
        start = 0
        for tensor, has_gradient in zip(tensors, present[len(STATISTICS) :], strict=True):
            if has_gradient:
                tensor.grad = flat[start : start + tensor.numel()].view_as(tensor).to(tensor)
            start += tensor.numel()
        self._with_gradient.clear()
        self._data_losses = self._in_order(data_losses.to(self._sums))
        return self._in_order(totals.to(self._sums))

    def _facts(self, rendered: Sequence[RenderedBatch], tensors: Sequence[Tensor]) -> Tensor:
        """The losses of this process, and the statistics and gradients that it has."""
        rounds = -(-len(self._views) // self.size)
        facts = torch.zeros(2 * rounds + len(STATISTICS) + len(tensors), dtype=torch.float64)
        for number, item in enumerate(rendered):
            facts[number], facts[rounds + number] = item.total.detach(), item.data_loss.detach()
            for place, name in enumerate(STATISTICS):
                has = getattr(item.context.rendered.statistics, name) is not None
                facts[2 * rounds + place] = has
        for index in self._with_gradient:
            facts[2 * rounds + len(STATISTICS) + index] = 1
        return facts.to(self._group.device)

    def _in_order(self, values: Float[Tensor, "size rounds"]) -> list[Tensor]:
        """One value for each view of the step."""
        return list(values.T.flatten()[: len(self._views)].unbind())

    # After the optimizer step.

    def observations(
        self,
        rendered: Sequence[RenderedBatch],
        refiners: Refiners,
        absent: Callable[[int], StepContext],
    ) -> Iterator[Observation]:
        """The views of all processes; images of others only if a refiner reads them."""
        reads_images = any(_reads_images(refiner) for refiner in refiners)
        for number, first in enumerate(range(0, len(self._views), self.size)):
            own = rendered[number] if number < len(rendered) else None
            contexts = [absent(view) for view in self._views[first : first + self.size]]
            if reads_images:
                images = self._group.gathered(None if own is None else _images(own.context))
                contexts = [
                    replace(context, **moved(found, self._group.device))
                    for context, found in zip(contexts, images, strict=False)
                    if found is not None
                ]
            rows = contexts[0].num_rows if refiners.observes else 0
            found = self._by_row(own, rows)
            found = self._group.all_gather(found) if rows else found.expand(self.size, -1, 0)
            for place, context in enumerate(contexts):
                loss = self._data_losses[first + place]
                if place == self.rank and own is not None:
                    yield Observation(own.context, own.context.rendered.statistics, loss)
                else:
                    yield Observation(context, self._statistics(found[place]), loss)

    def _by_row(self, own: RenderedBatch | None, num_rows: int) -> Float[Tensor, "k n"]:
        """The statistics of the view of this process, of ``num_rows`` rows: all, or none."""
        values = torch.zeros(len(self._measured), num_rows, device=self._group.device)
        if own is None or not num_rows:
            return values
        rows = own.context.splats.rows
        for place, name in enumerate(self._measured):
            found = getattr(own.context.rendered.statistics, name)[0].to(values)
            if rows is None:
                values[place] = found
            else:
                values[place].index_copy_(0, rows, found)
        return values

    def _statistics(self, values: Float[Tensor, "k n"]) -> RenderStatistics:
        found = dict(zip(self._measured, values[:, None], strict=True))
        return RenderStatistics(**{**found, "visible": found["visible"].bool()})

    def visible(self, visible: Bool[Tensor, " n"]) -> Bool[Tensor, " n"]:
        """Rows that any process has seen."""
        return self._group.all_gather(visible.to(torch.uint8)).bool().any(0)


def _in_parts(tensors: Sequence[Tensor], size: int) -> list[list[Float[Tensor, " k"]]]:
    """The gradients one after another, in equal parts; 0 for tensors without a gradient."""
    grads = [torch.zeros_like(t) if t.grad is None else t.grad for t in tensors]
    dtype = reduce(torch.promote_types, (grad.dtype for grad in grads))
    flat = [grad.flatten().to(dtype) for grad in grads]
    flat.append(flat[0].new_zeros(-sum(map(len, flat)) % size))
    length = sum(map(len, flat)) // size
    parts: list[list[Tensor]] = [[] for _ in range(size)]
    start = 0
    for values in flat:
        ends = [*range(length - start % length, len(values), length), len(values)]
        for begin, end in pairwise([0, *ends]):
            if begin < end:
                parts[(start + begin) // length].append(values[begin:end])
        start += len(values)
    return parts


def _reads_images(refiner: Refiner) -> bool:
    return refiner.reads_images and type(refiner).observe is not Refiner.observe


def _images(context: StepContext) -> dict[str, object]:
    """The images of a view, without a graph, in host memory."""
    rendered = context.rendered
    output = replace(
        rendered,
        color=rendered.color.detach(),
        alpha=rendered.alpha.detach(),
        depth=None if rendered.depth is None else rendered.depth.detach(),
        extra=None if rendered.extra is None else rendered.extra.detach(),
    )
    return {"batch": context.batch, "target": context.target, "rendered": output}
