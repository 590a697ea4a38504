"""Step graphs: steps that are recorded once, and repeated for other views.

On a small scene the host takes longer to start the kernels of a step than a GPU to run them. What a
step does between its batch and its new parameters is therefore recorded as one graph, which reads
its inputs (images, cameras, background, learning rates) where they are copied to. A graph holds for
the sizes of the images of a step and for one set of rows: after a refinement the first step is run
as usual, and the second one is recorded.

The number of pairs of a captured image is not known to the host, so its memory may turn out to be
too small. Such a step changes nothing; its count is read some steps later, and further graphs have
more room.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Hashable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from traceback import clear_frames

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.errors import UnavailableError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.forward import RenderedBatch
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.loop.recordable import can_be_recorded, graph_key, has_graphs, promises
from gsfw.core.loop.recording import Recorder, Recording
from gsfw.core.loop.step_inputs import StepInputs
from gsfw.core.loop.training_parts import TrainingParts

logger = logging.getLogger(__name__)

MOST_GRAPHS = 8
"""Graphs for the same rows; steps of further kinds, as of other sizes, are run one by one."""

UNUSED_STEPS = 256
"""A graph that was not replayed for so many steps makes room for one of another kind."""

FIRST_STEPS = 16
"""Steps of a run that are not recorded, to see how much memory the images of several views need."""

LOOK_EVERY = 32
"""Replays between two looks at the steps that did not fit into their memory; fewer at first."""

RATE_STEPS = 256
"""Steps whose learning rates are sent to the device at once."""


@dataclass(frozen=True)
class Outcome:
    """The results of a step, on the device."""

    rendered: list[RenderedBatch]
    finite: Tensor
    """True if the parameters were changed."""
    is_gated: bool = False
    """True if the statistics of a step that changed nothing are zeros already."""


Work = Callable[[StepInputs, int], Outcome]
"""A step from its inputs to its outcome, given its number."""


@dataclass(frozen=True)
class _Graph:
    """A recorded step."""

    recording: Recording
    inputs: StepInputs
    outcome: Outcome
    gradients: list[tuple[Tensor, Tensor | None]]
    """Parameters and their gradients, for refiners that read them after the step."""


@dataclass
class _Kind:
    """Steps of one kind, with the same rows."""

    used: int
    """Number of steps that were run until the latest of this kind."""
    graph: _Graph | None = None
    """Recorded at the second such step; the first one is run as usual."""


class StepGraphs:
    """Runs steps, by graphs where that can be done."""

    def __init__(self, parts: TrainingParts, recorder: Recorder | None) -> None:
        """Nothing is recorded yet; nothing ever is without a ``recorder``."""
        self._parts = parts
        self._recorder = recorder if has_graphs(parts) else None
        self._kinds: dict[Hashable, _Kind] = {}
        self._rows: Hashable = None
        self._rates = _Rates(parts.optimizer, parts.device)
        self._misfits = torch.zeros((), dtype=torch.int64, device=parts.device)
        self._look = _Look(self._misfits)
        self._steps = self._replays = 0
        self._told_of_more = False

    def working(self) -> AbstractContextManager[None]:
        """The context of all steps of a run: the recorder's, if any of them may be recorded.

        Other methods may start kernels on the default stream, whatever torch's current stream is.
        """
        if self._recorder is None or not promises(self._parts.method):
            return nullcontext()
        return self._recorder.working()

    def run(self, inputs: StepInputs, step: int, work: Work) -> Outcome:
        """Run a step, after ``Method.prepare``.

        Args:
            inputs: of the step.
            step: its number, counted from 0.
            work: the step; it reads nothing else that differs from step to step.
        """
        self._steps += 1
        self._follow_rows()
        known = self._known(inputs, step) if self._steps > FIRST_STEPS else None
        if known is None:
            return work(inputs, step)
        graph = known.graph or self._recorded(inputs, step, work)
        if graph is None:
            return work(inputs, step)
        known.graph = graph
        try:
            return self._replayed(graph, inputs, step)
        except torch.OutOfMemoryError as error:  # Nothing has been launched.
            reason = _reason(error)
        graph = known.graph = None  # Else its memory would stay during the step.
        self._give_up_step()
        self._end(reason)
        return work(inputs, step)

    def drop(self) -> bool:
        """Give back the memory of all graphs; false if there was none. Others may follow."""
        had = any(kind.graph is not None for kind in self._kinds.values()) or self.idle_memory > 0
        for kind in self._kinds.values():
            kind.graph = None
        if had and self._recorder is not None:
            self._recorder.release(at_once=True)
        return had

    @property
    def idle_memory(self) -> int:
        """Bytes that only the graphs can use, beyond those of tensors."""
        return 0 if self._recorder is None else self._recorder.idle_memory

    def fitting(self, finite: Tensor) -> tuple[Tensor, Tensor]:
        """Two flags: a step may change parameters; a step counts as not finite.

        Neither holds for a step whose images did not fit into their memory; it is counted here.
        """
        fits = self._parts.rasterizer.fits()
        if fits is None:
            return finite, ~finite
        self._misfits += ~fits
        return finite & fits, fits & ~finite

    def _kind(self, inputs: StepInputs, step: int) -> Hashable | None:
        """The kind of a step, which has a graph of its own; ``None`` if it cannot be recorded."""
        parts = self._parts
        if self._recorder is None:
            return None
        own, refiners = graph_key(parts.method, step), parts.refiners
        if own is None or not all(can_be_recorded(refiner, step) for refiner in refiners):
            return None
        measured = refiners.statistics(step), refiners.depth(step)
        whole = parts.distractors is None or not parts.distractors.are_left_out(step)
        return own, measured, whole, inputs.kind()

    def _follow_rows(self) -> None:
        """Forget the graphs of other rows, which are kept in memory by them."""
        if self._recorder is None:
            return
        rows = self._parts.optimizer.places()
        if rows != self._rows:
            self._kinds.clear()
            self._recorder.release()
            self._rows = rows

    def _known(self, inputs: StepInputs, step: int) -> _Kind | None:
        """The kind of a step if it has been run with the rows that there are; else it is noted."""
        kind = self._kind(inputs, step)
        if kind is None:
            return None
        found = self._kinds.pop(kind, None)
        if found is None:
            self._make_place()
            if len(self._kinds) < MOST_GRAPHS:
                self._kinds[kind] = _Kind(self._steps)
            return None
        found.used = self._steps
        self._kinds[kind] = found  # The latest one comes last.
        return found

    def _make_place(self) -> None:
        """Forget, of too many kinds, the one that was not used for the longest time."""
        if len(self._kinds) < MOST_GRAPHS:
            return
        name, oldest = next(iter(self._kinds.items()))
        if oldest.used < self._steps - UNUSED_STEPS:
            del self._kinds[name]
        elif not self._told_of_more:
            self._told_of_more = True
            logger.info(
                "steps have more than %d kinds (sizes and numbers of images): not all of them are "
                "recorded in CUDA graphs, which takes time",
                MOST_GRAPHS,
            )

    def _recorded(self, inputs: StepInputs, step: int, work: Work) -> _Graph | None:
        """Record a step; ``None`` where that fails, and no further attempts.

        Where memory is full, a second attempt has that of all other graphs.
        """
        for is_last in (False, True):
            try:
                return self._record(inputs, step, work)
            except (RuntimeError, UnavailableError) as error:
                is_full, reason = isinstance(error, torch.OutOfMemoryError), _reason(error)
                clear_frames(error.__traceback__)  # They hold the tensors of this attempt.
            self._give_up_step()
            if is_last or not (is_full and self.drop()):
                break
        self._end(reason)
        return None

    def _record(self, inputs: StepInputs, step: int, work: Work) -> _Graph:
        assert self._recorder is not None
        self._rates.follow()
        own = replace(inputs.copied(), rates=self._rates.at(step))
        outcomes: list[Outcome] = []
        gradients: list[tuple[Tensor, Tensor | None]] = []

        def record() -> None:
            outcomes.append(_detached(work(own, step)))
            gradients.extend((leaf, leaf.grad) for leaf in self._parts.optimizer.tensors())

        recording = self._recorder.record(record)
        return _Graph(recording, own, outcomes[0], gradients)

    def _give_up_step(self) -> None:
        """Drop the results of a step that was not recorded to its end, or not launched."""
        self._parts.optimizer.zero_gradients()
        self._parts.rasterizer.fits()  # The flags of images that were never rendered.

    def _end(self, reason: str) -> None:
        """Record no more steps, and say why."""
        logger.warning("steps are not recorded in CUDA graphs, which takes time: %s", reason)
        recorder, self._recorder = self._recorder, None
        self._kinds.clear()
        if recorder is not None:
            recorder.release(at_once=True)

    def _replayed(self, graph: _Graph, inputs: StepInputs, step: int) -> Outcome:
        torch._foreach_copy_(graph.inputs.tensors(), inputs.tensors())
        self._rates.at(step)
        graph.recording.replay()
        for leaf, gradient in graph.gradients:
            leaf.grad = gradient
        self._replays += 1
        if self._looks() and self._look.is_higher():
            logger.info("images of recorded steps had no room; the next recordings have more")
            self._parts.rasterizer.make_room()
            self._kinds.clear()
            if self._recorder is not None:
                self._recorder.release()
        pairs = zip(graph.outcome.rendered, inputs.batches, strict=True)
        return replace(graph.outcome, rendered=[_shown(*pair, step) for pair in pairs])

    def _looks(self) -> bool:
        """True after 1, 2, 4 and so on replays, and then after every ``LOOK_EVERY``."""
        replays = self._replays
        return replays % LOOK_EVERY == 0 or (replays < LOOK_EVERY and replays.bit_count() == 1)


class _Rates:
    """Learning rates on the device: a graph reads them by the number of the step."""

    def __init__(self, optimizer: Optimizer, device: torch.device) -> None:
        self._optimizer, self._device = optimizer, device
        self._schedules: dict[str, LearningRate] = {}
        self._begin = 0
        self._table = torch.empty(0, 0, dtype=torch.float64)
        self._current = torch.empty(0, dtype=torch.float64)

    def follow(self) -> None:
        """Look for other columns, groups and schedules before a recording; they stay with it."""
        schedules = self._optimizer.schedules()
        if schedules.keys() != self._schedules.keys():
            self._current = torch.empty(len(schedules), dtype=torch.float64, device=self._device)
        if schedules != self._schedules:
            self._schedules, self._table = schedules, self._table[:0]

    def at(self, step: int) -> Float64[Tensor, " g"]:
        """The rates of a step, always at the same place while columns and groups stay."""
        if not 0 <= step - self._begin < len(self._table):
            self._send(step)
        self._current.copy_(self._table[step - self._begin])
        return self._current

    def _send(self, step: int) -> None:
        steps = range(step, step + RATE_STEPS)
        rows = [list(self._optimizer.learning_rates(number).values()) for number in steps]
        self._table = torch.tensor(rows, dtype=torch.float64).to(self._device)
        self._begin = step


class _Look:
    """Reads a count of the device without waiting for the latest steps."""

    def __init__(self, count: Tensor) -> None:
        self._count, self._known = count, 0
        on_gpu = count.is_cuda
        self._told = torch.zeros((), dtype=count.dtype, pin_memory=on_gpu)
        self._event = torch.cuda.Event() if on_gpu else None

    def is_higher(self) -> bool:
        """True if the count had grown when this was last called."""
        if self._event is not None:
            self._event.synchronize()
        known, self._known = self._known, int(self._told)
        self._told.copy_(self._count, non_blocking=True)
        if self._event is not None:
            self._event.record()
        return self._known > known


def _reason(error: Exception) -> str:
    """The first line of a message."""
    return str(error).partition("\n")[0]


def _detached(outcome: Outcome) -> Outcome:
    """The same without the graph of autograd, which ends with the step; gated."""
    rendered = [_without_graph(item, outcome.finite) for item in outcome.rendered]
    return replace(outcome, rendered=rendered, is_gated=True)


def _shown(item: RenderedBatch, batch: Batch, step: int) -> RenderedBatch:
    """The result of a replay, as that of a step and of its views."""
    repeated = replace(item.context.batch, views=batch.views)
    return replace(item, context=replace(item.context, step=step, batch=repeated))


def _without_graph(item: RenderedBatch, finite: Tensor) -> RenderedBatch:
    context = item.context
    output = context.rendered
    images = {name: getattr(output, name) for name in ("color", "alpha", "depth", "extra")}
    images = {name: image.detach() for name, image in images.items() if image is not None}
    rendered = replace(output, **images, statistics=output.statistics.where(finite))
    splats = context.splats.map(lambda tensor: tensor.detach())
    cameras = context.batch.cameras
    cameras = replace(cameras, world_to_camera=cameras.world_to_camera.detach())
    batch = replace(context.batch, cameras=cameras)
    context = replace(context, batch=batch, splats=splats, rendered=rendered)
    losses = {name: value.detach() for name, value in item.losses.items()}
    return replace(item, context=context, losses=losses, total=item.total.detach(), by_rows=())
