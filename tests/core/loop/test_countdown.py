"""Countdown: the time left of a run, from what a callback sees."""

import pytest

from gsfw.core.callback import RunInfo, StepReport
from gsfw.core.loop.countdown import Countdown


class Run:
    """A run by a clock of its own: steps of 100 ms, and what comes between them."""

    def __init__(self, tmp_path, monkeypatch):
        self.now = 1000.0
        monkeypatch.setattr("time.monotonic", lambda: self.now)
        self.countdown = Countdown(RunInfo(tmp_path, "3dgs", "toy", 1000, 0, {}, {"views": 10}))

    def steps(self, first: int, last: int, between: float = 0.0) -> None:
        """Ten steps a report; after each step others have the time ``between``."""
        for step in range(first + 1, last + 1):
            self.now += 0.1
            self.countdown.tick()
            self.now += between
            if step % 10 == 0:
                self.countdown.report(StepReport(step, 0.1, {}, 20.0, 10_000, {}, 100.0))


@pytest.fixture
def run(tmp_path, monkeypatch):
    return Run(tmp_path, monkeypatch)


def test_what_others_take_between_steps_counts(run):
    run.steps(0, 200)
    alone = run.countdown.seconds()
    assert alone == pytest.approx(80.0, rel=0.05)
    run.steps(200, 400, between=0.025)  # A page has a fifth of the time.
    assert run.countdown.stretch == pytest.approx(1.25)
    assert run.countdown.seconds() == pytest.approx(75.0, rel=0.05)


def test_a_long_pause_does_not_count(run):
    run.steps(0, 200)
    before = run.countdown.seconds()
    run.now += 3600.0
    run.countdown.skip(3600.0)
    assert run.countdown.seconds() == pytest.approx(before)
    run.steps(200, 210)
    assert run.countdown.seconds() == pytest.approx(79.0, rel=0.05)


def test_a_pause_of_which_the_countdown_does_not_know_counts_for_one_report_at_most(run):
    run.steps(0, 200)
    run.now += 3600.0
    run.steps(200, 210)
    assert run.countdown.seconds() == pytest.approx(79.0, rel=0.05)


def test_evaluations_to_come_count(run):
    run.steps(0, 200)
    before = run.countdown.seconds()
    run.now += 5.0
    run.countdown.evaluated(200, 10)  # The one at the end has as many views.
    run.steps(200, 210)
    assert run.countdown.seconds() == pytest.approx(before - 1.0 + 5.0, rel=0.05)
