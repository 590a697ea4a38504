"""Promises of strategies: edits that any model, batch and limit allows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import ClassVar

import torch

from gsfw.core.batch import Batch
from gsfw.core.callback import Callback, Control
from gsfw.core.datamanager import Split, WrappedDataManager
from gsfw.core.errors import ConfigError
from gsfw.core.loop.trainer import Trainer
from gsfw.core.model import PrimitiveModel
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.refiner import GrowthLimits, RefineContext, Refinement, Refiner
from gsfw.core.step_settings import step_settings
from gsfw.testing.promise import RAISED, BrokenPromise, NotApplicable, Promise, require
from gsfw.testing.subject import Subject
from gsfw.testing.table_checks import check_table
from gsfw.testing.trial import (
    MOTION,
    Changes,
    Trial,
    require_equal_resume,
    require_own_generator,
    trial,
)

STEPS, HALF = 60, 40
"""Length of the runs, and the step from which one is resumed."""
LEAST = 6
"""Shortest interval of the shortened schedules."""
USUAL_STEPS = 30_000
"""Length of the runs that the defaults of strategies are meant for."""
NOT_FINITE_EVERY = 7
"""Every seventh load of images of the run with broken steps has NaN."""
MOST = 90
"""Rows under a limit; the runs start with 80."""


@dataclass
class TableWatch(Callback):
    """Checks the rows of a model after each step."""

    trainer: Trainer | None = None
    rows: list[int] = field(default_factory=list)
    broken: BrokenPromise | None = None

    def on_tick(self, step: int, control: Control) -> None:
        """Check a step; the first fault ends the run."""
        assert self.trainer is not None
        parts = self.trainer.parts
        self.rows.append(len(parts.table))
        try:
            check_table(parts.model, parts.optimizer, f"after step {step}")
        except BrokenPromise as broken:
            self.broken = broken
            control.request_stop("the table is broken")


class _Limited(Refiner):
    """Limits of the kit, as a budget would set them."""

    name: ClassVar[str] = "limits of the conformance kit"

    def __init__(self, given: GrowthLimits) -> None:
        self._given = given

    def limits(self, step: int, model: PrimitiveModel) -> GrowthLimits:
        """The same limits after all steps."""
        return self._given

    def refine(self, context: RefineContext) -> Refinement:
        """Edit nothing."""
        return {}


class _SometimesBroken(WrappedDataManager):
    """Data with NaN in the images of some calls, so that steps are not finite."""

    loads = 0

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Load batches; those of every seventh call have NaN."""
        batches = super().load(split, indices, device)
        self.loads += split is Split.TRAIN
        if split is not Split.TRAIN or self.loads % NOT_FINITE_EVERY:
            return batches
        return [replace(batch, images=batch.images * torch.nan) for batch in batches]


def watched(trainer: Trainer, watch: TableWatch) -> list[int]:
    """Train with a check of the rows after each step; the number of rows after each.

    Raises:
        BrokenPromise: the rows of a step are not sound.
    """
    watch.trainer = trainer
    trainer.fit()
    if watch.broken is not None:
        raise watch.broken
    return watch.rows


def _run(subject: Subject, name: str, changes: Changes, method: str = "3dgs") -> Trial:
    """A run with the strategy, with a shortened schedule, so that all of its phases occur.

    Rescaling by steps= would keep the lower bounds of intervals, and such a run would edit nothing.
    """
    schedule = {
        f"strategy.{key}": max(round(steps * STEPS / USUAL_STEPS), LEAST)
        for key, (steps, _) in step_settings(subject.target()).items()
        if steps and not any(item.startswith(f"strategy.{key}=") for item in subject.settings)
    }
    given = {"strategy": subject.name, "steps": STEPS, **schedule, **changes}
    return trial(subject, name, given, method)


def _runs_with(method: str, changes: Changes, subject: Subject) -> None:
    """Check a run of a built-in method."""
    watch = TableWatch()
    try:
        trainer = _run(subject, f"with-{method}", changes, method).trainer([watch])
    except ConfigError as refusal:
        raise NotApplicable(f"it is refused: {refusal.message}") from refusal
    watched(trainer, watch)


def _several_batches(subject: Subject) -> None:
    watch = TableWatch()
    changes = {"sampler": "uniform", "sampler.views_per_step": 3}
    watched(_run(subject, "several", changes).trainer([watch]), watch)


def _steps_that_are_not_finite(subject: Subject) -> None:
    watch = TableWatch()
    run = _run(subject, "not-finite", {"max_skipped": STEPS})
    trainer = run.trainer([watch], _SometimesBroken(run.data()))
    watched(trainer, watch)
    skipped = trainer.state_dict()["skipped"]
    require(int(skipped) > 0, "no step was skipped.", "This is a fault of the kit: report it.")


def _respects(limits: GrowthLimits, advice: str, subject: Subject) -> None:
    """Check that no row is added or removed against limits."""
    watch = TableWatch()
    trainer = _run(subject, "limited", {}).trainer([watch])
    trainer.parts = replace(
        trainer.parts, refiners=Refiners([_Limited(limits), *trainer.parts.refiners])
    )
    before = len(trainer.parts.table)
    rows = [before, *watched(trainer, watch)]
    grown = next((b for a, b in pairwise(rows) if b > a), before)
    if limits.hold:
        require(set(rows) == {before}, f"rows change from {before} to {rows[-1]}.", advice)
    elif not limits.may_grow:
        require(grown <= before, f"rows grow from {before} to {grown}.", advice)
    else:
        require(max(rows) <= MOST, f"{max(rows)} rows where {MOST} are allowed.", advice)


def _resumes(subject: Subject) -> None:
    run = _run(subject, "resumed", {"checkpoint_every": HALF})
    run.trainer().fit()
    require_equal_resume(
        run,
        HALF,
        STEPS,
        "Return all state of the refiner in state_dict, and read it in load_state_dict; draw "
        "random numbers only from context.generator.",
    )


def _leaves_the_global_generator(subject: Subject) -> None:
    require_own_generator(
        lambda name: _run(subject, name, {}),
        STEPS,
        "Pass generator=context.generator to every torch.rand, randn, randperm and multinomial.",
    )


ROOM = "Add at most context.limits.room(rows, wanted) rows."
LIMITS: Mapping[str, tuple[GrowthLimits, str, str]] = {
    "respects-max-rows": (
        GrowthLimits(max_rows=MOST),
        "A limit of rows, such as a budget, is never exceeded.",
        ROOM,
    ),
    "respects-may-grow": (
        GrowthLimits(may_grow=False),
        "No row is added while the limits forbid growth.",
        ROOM,
    ),
    "respects-hold": (
        GrowthLimits(hold=True),
        "No row is added or removed while the limits hold the rows.",
        "Return {} from refine while context.limits.hold is true.",
    ),
}
"""Limits, the promise, and the remedy, by name."""

METHODS: Mapping[str, Changes] = {
    "3dgs": {},
    **dict.fromkeys(("spacetime", "4d-rotor", "4dgs", "dynamic3dgs"), MOTION),
}
"""Built-in methods and the settings of their scene. 4d-rotor and spacetime render some rows only,
those that are present at a time."""

SENTENCE = "It trains method {}, with valid rows after each step, or is refused with a message."


NOT_FINITE = (
    "Look at what the refiner gathers in before_backward: images, losses and gradients of such a "
    "step have NaN, which nan_to_num() removes. observe gets zeros. " + RAISED
)


PROMISES = (
    *(
        Promise(
            f"runs-with-{method}", SENTENCE.format(method), partial(_runs_with, method, changes)
        )
        for method, changes in METHODS.items()
    ),
    Promise(
        "several-batches",
        "It trains with several batches per step, with valid rows after each step.",
        _several_batches,
    ),
    Promise(
        "not-finite-steps",
        "Rows stay valid and finite after steps that are not finite.",
        _steps_that_are_not_finite,
        raised=NOT_FINITE,
    ),
    *(
        Promise(name, sentence, partial(_respects, limits, advice))
        for name, (limits, sentence, advice) in LIMITS.items()
    ),
    Promise(
        "resumes-to-the-same-bits",
        "A resumed run ends with the same bits as an uninterrupted one.",
        _resumes,
    ),
    Promise(
        "uses-the-given-generator",
        "Random numbers come only from the generator of the run.",
        _leaves_the_global_generator,
    ),
)
