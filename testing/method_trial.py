"""Method trial: the small runs of a method that its promises look at."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch

from gsfw.core.callback import Callback, Control, RunInfo
from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError
from gsfw.core.loop.trainer import Trainer
from gsfw.core.model import PrimitiveModel
from gsfw.core.splats import Splats
from gsfw.plugins.registry import PartError
from gsfw.testing.promise import BrokenPromise, NotApplicable
from gsfw.testing.subject import Subject
from gsfw.testing.trial import MOTION, Changes, Losses, Trial, trial

STEPS, HALF = 48, 24
"""Length of the run that most checks look at: eight turns of the training views; its half."""
TIMES = (0.0, 0.5, 1.0)
"""Times at which splats are compared."""


def method_trial(subject: Subject, name: str, changes: Changes) -> Trial:
    """A run of the method on the still scene if it takes that, else on the moving one.

    Raises:
        BrokenPromise: it refuses both; at the first call for a subject.
        NotApplicable: it refuses both; at later calls.
    """
    scene = subject.once("scene of the method", lambda: _scene(subject))
    return trial(subject, name, {"steps": STEPS, **scene, **changes}, subject.name)


def _scene(subject: Subject) -> Changes:
    if subject.data is not None:
        return {}
    refused = subject.once("refusals", dict[str, str])
    if refused:
        raise NotApplicable("not checked: it refuses the built-in scene, as another promise tells")
    for kind, motion in (("static", {}), ("moving", MOTION)):
        try:
            trial(subject, "scene", {"steps": STEPS, **motion}, subject.name).composition()
        except PartError as error:
            raise BrokenPromise(f"{error.reason}.", error.advice) from error
        except ConfigError as error:
            refused[kind] = error.message
        else:
            refused.clear()
            return motion
    told = " ".join(f"The {kind} one: {message}" for kind, message in refused.items())
    raise BrokenPromise(
        f"it refuses the built-in scene. {told}",
        "If it needs other data, name some: gsfw plugins check NAME data=PATH, or "
        "conformance(..., data=PATH) in a test.",
    )


class Halfway(Callback):
    """Keeps the splats that callbacks see at the first checkpoint."""

    splats: tuple[Mapping[str, object], ...] = ()
    """Splats at each of ``TIMES``."""

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Keep the model."""
        assert run.model is not None  # A run that trains has one.
        self._model = run.model

    def on_checkpoint(self, step: int, path: Path) -> None:
        """Copy the splats."""
        if step == HALF:
            shown = (self._model.splats(torch.tensor(time)) for time in TIMES)
            self.splats = tuple(flat(splats) for splats in shown)


def trained(subject: Subject) -> tuple[Trainer, Losses, Halfway]:
    """A trained run, which several checks look at."""

    def train() -> tuple[Trainer, Losses, Halfway]:
        run = method_trial(subject, "trained", {"checkpoint_every": HALF})
        losses, halfway = Losses(), Halfway()
        trainer = run.trainer([losses, halfway])
        trainer.fit()
        return trainer, losses, halfway

    return subject.once("trained run", train)


@torch.no_grad()
def splats_at(model: PrimitiveModel, time: float | None, camera: Cameras | None = None) -> Splats:
    """The splats at a time for a camera, without gradients."""
    return model.splats(None if time is None else torch.tensor(time), camera)


def flat(splats: Splats) -> Mapping[str, object]:
    """Copies of their tensors by name."""
    return {name: tensor.clone() for name, tensor in splats.tensors().items()}
