"""The viewer of a run that trains: the same bits, a pause that holds, no page that stalls it."""

import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from support.small_scene import SMALL_SCENE
from support.viewer_page import open_page
from support.viewing import BLACK, OneView, still_model

from gsfw.commands.main import main
from gsfw.core.callback import Control, RunInfo, StepReport
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.countdown import Countdown
from gsfw.core.loop.model_handle import ModelHandle
from gsfw.core.loop.run_folder import RunFolder
from gsfw.viewer import training
from gsfw.viewer.training import TrainingViewer
from gsfw.viewer.view_state import Pose

FRONT = Pose((0.0, 0.0, -4.0), (1.0, 0.0, 0.0, 0.0), 0.8)
TRAIN = ("train", "method=3dgs", *SMALL_SCENE, "device=cpu", "callbacks.tensorboard.enabled=false")


@pytest.fixture
def servers(monkeypatch):
    """The servers that runs start, as they start."""
    started = []

    class Recorded(training.ViewerServer):
        def start(self, session, pages):
            super().start(session, pages)
            started.append(self)

    monkeypatch.setattr(training, "ViewerServer", Recorded)
    return started


@pytest.fixture
def viewer(tmp_path):
    """A viewer of a run whose steps the test makes."""
    model = still_model()
    handle = ModelHandle(model.model, model.rasterizer, BLACK)
    info = RunInfo(tmp_path, "3dgs", "toy", 100, 0, {}, {}, model=handle, data=OneView((0, 0, 0)))
    callback, control = TrainingViewer(0, 0.2), Control()
    callback.on_start(info, control)
    callback.control = control
    yield callback
    callback.close()


class Steps(threading.Thread):
    """A training loop without training."""

    def __init__(self, viewer):
        super().__init__(daemon=True)
        self.viewer, self.step, self.checkpoints = viewer, 0, 0

    def run(self):
        control = self.viewer.control
        while control.stop_reason is None and self.step < 10_000:
            time.sleep(0.002)
            self.step += 1
            self.viewer.on_tick(self.step, control)
            if control.checkpoint_requested:
                control.checkpoint_requested = False
                self.checkpoints += 1
                self.viewer.on_checkpoint(self.step, Path("checkpoint"))


def soon(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    assert condition()


@pytest.mark.slow
def test_a_run_has_the_same_bits_with_a_page_that_moves(tmp_path, servers):
    frames, ended = [], threading.Event()

    def look():
        while not servers and not ended.is_set():
            time.sleep(0.01)
        with open_page(servers[0].address) as page:
            for turn in range(10_000):
                if ended.is_set():
                    return
                page.look(replace(FRONT, position=(0.01 * turn, 0.0, -4.0)))
                try:
                    frames.append(page.wait_for_frame(seconds=5))
                except Exception:  # The run is over.
                    return

    assert main([*TRAIN, "steps=40", f"out={tmp_path / 'plain'}"]) == 0
    page = threading.Thread(target=look)
    page.start()
    try:
        assert main([*TRAIN, "steps=40", f"out={tmp_path / 'seen'}", "viewer=true"]) == 0
    finally:
        ended.set()
        page.join(20)
    assert frames
    states = [
        read_checkpoint(RunFolder(tmp_path / name).latest_checkpoint())["model"]
        for name in ("plain", "seen")
    ]
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])


@pytest.mark.slow
def test_the_settings_of_the_viewer_have_short_keys(tmp_path, servers):
    out = tmp_path / "run"
    assert main([*TRAIN, "steps=2", f"out={out}", "viewer=true", "viewer.share=0.1"]) == 0
    assert len(servers) == 1
    assert "share: 0.1" in (out / "config.yaml").read_text()


@pytest.mark.slow
def test_the_address_is_printed_on_standard_error(tmp_path, servers, capsys):
    out = tmp_path / "run"
    assert main([*TRAIN, "steps=2", f"out={out}", "viewer=true", "json=true"]) == 0
    told = capsys.readouterr()
    assert servers[0].address in told.err
    assert servers[0].ssh_line in told.err
    assert servers[0].secret not in told.out


def test_without_viser_training_is_refused_in_a_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name, package=None: None if name == "viser" else object()
    )
    assert main([*TRAIN, "steps=2", f"out={tmp_path / 'run'}", "viewer=true"]) == 2
    assert "pip install 'gsfw[viewer]'" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_a_pause_holds_the_run_and_serves_pages(viewer):
    steps = Steps(viewer)
    steps.start()
    with open_page(viewer._server.address) as page:
        page.look(FRONT)
        page.wait_for_frame()
        viewer._live.pause(True)
        time.sleep(0.2)
        held = steps.step
        page.look(replace(FRONT, position=(0.5, 0.0, -4.0)))
        page.wait_for_frame()
        assert steps.step == held
        viewer._live.pause(False)
        soon(lambda: steps.step > held)
    viewer.control.request_stop("the test is over")
    steps.join(20)


def test_it_says_pausing_until_the_run_waits(viewer):
    live = viewer._live
    assert live.state == "training"
    live.pause(True)
    assert live.state == "pausing"  # A step may still be in work.
    steps = Steps(viewer)
    steps.start()
    soon(lambda: live.state == "paused")
    held = steps.step
    viewer.control.request_stop("the test is over")
    steps.join(20)
    assert steps.step == held


def test_an_order_holds_the_run_until_it_is_done(viewer):
    steps, seen = Steps(viewer), []

    def order():
        for _ in range(5):
            seen.append(steps.step)
            time.sleep(0.02)
            yield

    steps.start()
    soon(lambda: steps.step > 3)
    viewer._session.service.order(order())
    soon(lambda: len(seen) == 5 and not viewer._session.service.has_orders)
    held = seen[0]
    assert seen == [held] * 5  # One model from the first frame to the last.
    soon(lambda: steps.step > held)
    viewer.control.request_stop("the test is over")
    steps.join(20)


def test_a_stop_gives_up_what_is_ordered(viewer):
    steps, ended = Steps(viewer), []

    def endless():
        try:
            while True:
                yield
        finally:
            ended.append(True)

    viewer._session.service.order(endless())
    steps.start()
    soon(lambda: viewer._live.state == "waiting for an order")
    viewer._live.stop()
    steps.join(20)
    assert not steps.is_alive()
    viewer.close()
    assert ended


def test_the_time_left_of_the_page_is_that_of_the_terminal(viewer, monkeypatch):
    now = 1000.0
    monkeypatch.setattr("gsfw.core.loop.countdown.time.monotonic", lambda: now)
    live = viewer._live
    live._countdown = Countdown(live.info)
    terminal = Countdown(live.info)
    for step in range(1, 41):
        now += 0.25  # A fifth of it for the page.
        live.ticked(step)
        terminal.tick()
        report = StepReport(step, 0.5, {}, 20.0, 40, {}, 200.0)
        viewer.on_step(report, viewer.control)
        terminal.report(report)
    assert live.seconds_left == terminal.seconds()
    assert live.seconds_left == pytest.approx(60 * 0.25, rel=0.1)


def paused(viewer) -> Steps:
    """A loop that waits after its first step."""
    steps = Steps(viewer)
    viewer._live.pause(True)
    steps.start()
    soon(lambda: steps.step == 1)
    return steps


def test_a_stop_from_elsewhere_ends_a_pause(viewer):
    steps = paused(viewer)
    viewer.control.request_stop("interrupted by Ctrl-C")
    steps.join(20)
    assert not steps.is_alive()


def test_a_stop_on_the_page_ends_the_run(viewer):
    steps = paused(viewer)
    viewer._live.stop()
    steps.join(20)
    assert viewer.control.stop_reason == "stopped on the viewer's page"
    assert steps.step == 1


def test_a_checkpoint_of_a_paused_run_makes_no_step(viewer):
    steps = paused(viewer)
    viewer._live.checkpoint()
    soon(lambda: steps.checkpoints == 1)
    time.sleep(0.1)
    assert steps.step == 1
    assert viewer._live.checkpointed == 1
    viewer._live.pause(False)
    soon(lambda: steps.step > 1)
    viewer.control.request_stop("the test is over")
    steps.join(20)


def test_a_paused_run_without_a_page_goes_on_after_a_while(viewer, monkeypatch):
    monkeypatch.setattr(training, "ABANDONED_SECONDS", 0.2)
    steps = Steps(viewer)
    viewer._live.pause(True)
    steps.start()
    soon(lambda: steps.step > 2)
    assert not viewer._live.paused
    viewer.control.request_stop("the test is over")
    steps.join(20)


def test_a_page_that_takes_nothing_does_not_stall_the_run_and_gets_one_frame(viewer, monkeypatch):
    taken, rendered = threading.Event(), []
    monkeypatch.setattr(
        "gsfw.viewer.page.wait_until_taken", lambda client, given_up: taken.wait(60)
    )
    make = viewer._session.service.maker.make
    viewer._session.service.maker.make = lambda *given: rendered.append(1) or make(*given)
    steps = Steps(viewer)
    steps.start()
    with open_page(viewer._server.address) as page:
        page.look(FRONT)
        soon(lambda: rendered)
        held = steps.step
        page.look(replace(FRONT, position=(0.5, 0.0, -4.0)))
        soon(lambda: steps.step > held + 100)
        assert len(rendered) == 1
        taken.set()
        soon(lambda: len(rendered) > 1)
    viewer.control.request_stop("the test is over")
    steps.join(20)


def test_figures_of_steps_reach_the_page(viewer):
    for step in (10, 20, 30):
        viewer.on_step(StepReport(step, 0.5, {}, 20.0, 40, {}, 5.0), viewer.control)
    status = viewer._live.status
    assert (status.step, status.gaussians) == (30, 40)
    assert status.steps_per_second == pytest.approx(200)
    assert viewer._live.loss.arrays()[0].tolist() == [10, 20, 30]


def test_curves_of_long_runs_stay_short():
    from gsfw.viewer.live_run import MOST_POINTS, Curve

    curve = Curve()
    for step in range(10_000):
        curve.add(step, float(step))
    steps, values = curve.arrays()
    assert MOST_POINTS // 2 <= len(steps) < 2 * MOST_POINTS
    assert steps.tolist() == values.tolist()
    assert steps[-1] > 9_900
