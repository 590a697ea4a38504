"""Promises of samplers: the seed decides, the state is complete, all views are drawn."""

from __future__ import annotations

import torch

from gsfw.core.datamanager import Split, Views
from gsfw.core.errors import ConfigError
from gsfw.core.sampler import Sampler
from gsfw.testing.promise import NotApplicable, Promise, require
from gsfw.testing.subject import Subject
from gsfw.testing.trial import tiny_data

STEPS = 60
"""Length of the run: ten passes over the six views."""


def _views(subject: Subject) -> Views:
    """Views that the sampler takes: still ones if it can, else moving ones.

    Raises:
        NotApplicable: it takes neither.
    """
    reasons = []
    for moving in (False, True):
        views = tiny_data(moving).views(Split.TRAIN)
        try:
            subject.target().build(views, 0, STEPS)
        except ConfigError as error:
            reasons.append(error.message)
        else:
            return views
    raise NotApplicable(f"it refuses the views of the kit: {reasons[-1]}")


def _built(subject: Subject, seed: int = 0) -> Sampler:
    sampler: Sampler = subject.target().build(_views(subject), seed, STEPS)
    return sampler


def _drawn(sampler: Sampler, steps: int, first: int = 0) -> list[tuple[int, ...]]:
    """The views of some steps; the losses of each depend on the view and the step alone."""
    found = []
    for step in range(first, first + steps):
        views = tuple(sampler.next())
        losses = torch.tensor([0.1 + 0.05 * ((view * 7 + step) % 5) for view in views])
        sampler.observe(views, losses)
        found.append(views)
    return found


def _seed_decides(subject: Subject) -> None:
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(1)
        first = _drawn(_built(subject), STEPS)
        torch.manual_seed(2)
        second = _drawn(_built(subject), STEPS)
    step = next(
        (n for n, pair in enumerate(zip(first, second, strict=True)) if len({*pair}) > 1), -1
    )
    require(
        first == second,
        f"with one seed, step {step} has the views {first[step]}, and then {second[step]}.",
        "Draw only with torch.Generator().manual_seed(...) of the given seed.",
    )


def _state_is_complete(subject: Subject) -> None:
    for done in (1, STEPS // 3, STEPS // 2):
        whole, interrupted = _built(subject), _built(subject)
        _drawn(whole, done)
        interrupted.load_state_dict(_as_stored(whole.state_dict()))
        expected, found = _drawn(whole, 20, done), _drawn(interrupted, 20, done)
        require(
            expected == found,
            f"resumed after {done} steps, it continues with {found[:3]} instead of {expected[:3]}.",
            "Return all state of next() in state_dict, and read it in load_state_dict.",
        )


def _as_stored(state: dict[str, object]) -> dict[str, object]:
    """The state as a checkpoint returns it.

    Raises:
        Exception: it holds something else than tensors and plain data.
    """
    import io

    stored = io.BytesIO()
    torch.save(state, stored)
    stored.seek(0)
    read: dict[str, object] = torch.load(stored, weights_only=True)
    return read


def _all_views_are_seen(subject: Subject) -> None:
    views = _views(subject)
    seen = {view for step in _drawn(_built(subject), STEPS) for view in step}
    missing = sorted(set(range(len(views))) - seen)
    require(
        not missing,
        f"in {STEPS} steps the views {missing} of {len(views)} are never drawn.",
        "Draw every training view: a run has to learn from all of the data.",
    )
    foreign = sorted(seen - set(range(len(views))))
    require(not foreign, f"it asks for the views {foreign}.", f"Views are 0 to {len(views) - 1}.")


def _peek_changes_nothing(subject: Subject) -> None:
    plain, peeking = _built(subject), _built(subject)
    for step in range(STEPS // 2):
        peeking.peek(4)
        expected, found = _drawn(plain, 1, step), _drawn(peeking, 1, step)
        require(
            expected == found,
            f"after peek, step {step} has the views {found[0]} instead of {expected[0]}.",
            "peek looks ahead for prefetching: it must not advance, and must not draw from a "
            "generator that next() uses.",
        )


PROMISES = (
    Promise("seed-decides", "The seed alone decides the order of the views.", _seed_decides),
    Promise(
        "state-is-complete",
        "A sampler with a restored state continues with the same views.",
        _state_is_complete,
    ),
    Promise("all-views-are-seen", "Every training view is drawn.", _all_views_are_seen),
    Promise(
        "peek-changes-nothing", "peek does not change what next() returns.", _peek_changes_nothing
    ),
)
