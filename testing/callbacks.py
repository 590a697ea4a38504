"""Promises of callbacks: they accept every event, and change nothing."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from gsfw.core.callback import Callback, Control, StepReport
from gsfw.core.config import CallbackConfig
from gsfw.core.errors import UserError
from gsfw.testing.promise import NotApplicable, Promise, require
from gsfw.testing.subject import Subject
from gsfw.testing.trial import Trial, difference, trial

STEPS = 12
EVENTS = {"eval_every": 5, "checkpoint_every": 5, "log_every": 1, "steps": STEPS}
"""Settings with which each event occurs several times."""
STOP_AT = 4


@dataclass
class _StopsAt(Callback):
    """Asks for the end of a run after some steps."""

    step: int
    seen: list[int] = field(default_factory=list)

    def on_step(self, report: StepReport, control: Control) -> None:
        """Ask once."""
        if report.step == self.step:
            control.request_stop("the check asks for it")


def _built(subject: Subject) -> Callback:
    """The callback with its default settings, switched on.

    Raises:
        NotApplicable: it cannot work on this machine.
    """
    kind = subject.target
    if not issubclass(kind, CallbackConfig):
        callback: Callback = kind()
        return callback
    config = kind(enabled=True)
    try:
        config.check()
        made: Callback = config.build()
    except UserError as error:
        raise NotApplicable(f"it cannot work here: {error.message}") from error
    return made


def _run(subject: Subject, name: str) -> Trial:
    return trial(subject, name, EVENTS)


def _watched_run(subject: Subject) -> tuple[list[BaseException], dict[str, object]]:
    """Errors of the callback in a run, and the state of the run."""

    def run() -> tuple[list[BaseException], dict[str, object]]:
        raised: list[BaseException] = []
        made = _run(subject, "watched")
        made.trainer([_recording(_built(subject), raised)]).fit()
        return raised, made.state(STEPS)

    return subject.once("watched run", run)


def _recording(callback: Callback, raised: list[BaseException]) -> Callback:
    """The callback, whose errors are recorded before the trainer detaches it."""

    class Recording(Callback):
        origin = "the callback that is checked"

        def __getattribute__(self, name: str) -> object:
            if not name.startswith("on_") and name != "close":
                return super().__getattribute__(name)
            method = getattr(callback, name)

            def call(*arguments: object) -> None:
                try:
                    method(*arguments)
                except Exception as error:
                    raised.append(error)
                    raise

            return call

    return Recording()


def _takes_all_events(subject: Subject) -> None:
    raised, _ = _watched_run(subject)
    first = raised[0] if raised else None
    require(
        not raised,
        f"it raised {type(first).__name__}: {first}.",
        "Take the parameters of Callback; gsfw detaches a callback that raises.",
    )


def _changes_no_bits(subject: Subject) -> None:
    _, watched = _watched_run(subject)
    plain = _run(subject, "plain")
    plain.trainer().fit()
    found = difference(plain.state(STEPS), watched)
    require(
        not found,
        f"with the callback, {found}.",
        "Change no tensor of a report in place, and draw no numbers from the global generator.",
    )


def _leaves_the_global_generator(subject: Subject) -> None:
    with torch.random.fork_rng(devices=()):
        torch.manual_seed(5)
        callback, run = _built(subject), _run(subject, "generator")
        run.trainer([callback]).fit()
        watched = torch.get_rng_state()
        torch.manual_seed(5)
        _run(subject, "generator-plain").trainer().fit()
        plain = torch.get_rng_state()
    require(
        torch.equal(watched, plain),
        "the global generator has advanced.",
        "Use a torch.Generator of your own: other code may draw from the global one.",
    )


def _a_stop_works(subject: Subject) -> None:
    raised: list[BaseException] = []
    run = _run(subject, "stopped")
    trainer = run.trainer([_recording(_built(subject), raised), _StopsAt(STOP_AT)])
    summary = trainer.fit()
    require(
        summary["steps"] == STOP_AT and not summary["completed"] and not raised,
        f"a run that was stopped after step {STOP_AT} ends after {summary['steps']}"
        + (f", with {type(raised[0]).__name__}: {raised[0]}." if raised else "."),
        advice_after_a_stop(raised),
    )


def advice_after_a_stop(raised: list[BaseException]) -> str:
    """The remedy for a run that did not stop as asked, by what the callback raised."""
    if not raised:
        return "Call control.request_stop only to end the run."
    if isinstance(raised[0], KeyError):
        return "on_end is also called after a stopped run: use summary.get for missing figures."
    return "Correct the cause of this error: on_end and close are also called after a stopped run."


PROMISES = (
    Promise("takes-all-events", "It accepts all events of a run.", _takes_all_events),
    Promise("changes-no-bits", "A run has the same bits with and without it.", _changes_no_bits),
    Promise(
        "leaves-the-global-generator",
        "It draws no numbers from torch's global generator.",
        _leaves_the_global_generator,
    ),
    Promise("a-stop-works", "A stopped run ends without errors.", _a_stop_works),
)
