"""Tests of gsfw.api.runs: training, opening and resuming from Python."""

import json
import logging
import os
import pickle
import random
import signal
import threading
import traceback
import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import torch
from support.small_scene import SMALL_SCENE

from gsfw.api import Callback, ConfigError, DataError, Run, load, train
from gsfw.api import open as open_run
from gsfw.commands.main import main

pytestmark = pytest.mark.unchecked
"""Whole runs; and type checks draw random numbers."""

SMALL = dict(pair.split("=") for pair in SMALL_SCENE)


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    """Runs without a folder go below an empty one."""
    monkeypatch.chdir(tmp_path)


def quick(steps: int = 20, out: str = "run", **others) -> Run:
    extra = {"report": False, **others.pop("settings", {})}
    return train(
        method="3dgs", steps=steps, out=out, settings={**SMALL, **extra}, progress=False, **others
    )


class StopAt(Callback):
    """Sends Ctrl-C to this process after a step."""

    def __init__(self, last: int) -> None:
        self.last = last

    def on_tick(self, step, control):
        if step == self.last:
            os.kill(os.getpid(), signal.SIGINT)


def states() -> dict[str, object]:
    """Everything of this process that a training might leave behind."""
    logger = logging.getLogger("gsfw")
    return {
        "threads of torch": torch.get_num_threads(),
        "seed": torch.initial_seed(),
        "torch": torch.get_rng_state().tolist(),
        "numpy": str(np.random.get_state()),  # noqa: NPY002 - it has to stay as it is.
        "random": random.getstate(),
        "deterministic": torch.get_deterministic_debug_mode(),
        "type": torch.get_default_dtype(),
        "gradients": torch.is_grad_enabled(),
        "handlers": [*logger.handlers, *logging.getLogger().handlers],
        "level": logger.level,
        "signals": [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)],
        "warnings": list(warnings.filters),
        "environment": dict(os.environ),
        "folder": Path.cwd(),
    }


@pytest.mark.slow
def test_a_finished_run_is_opened_with_its_figures_views_and_images(finished_run, capsys):
    run = open_run(finished_run)
    assert repr(run) == f"<gsfw.Run {finished_run}: 3dgs, finished>"
    final = json.loads((finished_run / "metrics.json").read_text())
    assert run.metrics["psnr"] == final["psnr"]
    assert (run.steps, run.is_finished, run.settings["steps"]) == (20, True, 20)
    cameras = run.cameras()
    assert (len(cameras), len(run.cameras("train"))) == (2, 6)
    assert run.names() == run.evaluate().views
    assert len(set(run.names("train"))) == 6
    output = run.render(cameras, background="black", depth=True)
    assert output.color.shape == (2, 24, 32, 3)
    assert output.depth is not None
    assert run.model.num_gaussians == final["num_gaussians"]
    evaluation = run.evaluate()
    assert evaluation.means["psnr"] == final["psnr"]
    shown = run._repr_html_()
    assert "3dgs on synthetic, 20 of 20 steps" in shown
    assert f"{final['psnr']:.2f} dB" in shown
    assert shown.count("<img") == 4, "photo and render of two held-out views"
    assert "<img" in run.model._repr_html_()
    assert capsys.readouterr() == ("", "")


@pytest.mark.slow
def test_what_is_exported_renders_as_the_run_does(finished_run, tmp_path):
    run = open_run(finished_run)
    expected = run.render(run.cameras(), background="black").color
    for name in ("splats.ply", "model.gsfw"):
        model = load(run.export(tmp_path / name))
        found = model.render(run.cameras(), background="black").color
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"settings": {"strategy.grow_gard": 1}}, "unknown key 'strategy.grow_gard'"),
        ({"settings": {"optim.mean_lr": 1}}, "Did you mean 'optim.means_lr'"),
        ({"settings": {"sh_degree": "three"}}, "sh_degree=three: expected a whole number"),
        ({"settings": {"steps": 3}}, "steps is given twice"),
        ({"settings": {"config": "none.yaml"}}, "config=none.yaml: there is no such file"),
        ({"method": "4gds"}, "no method '4gds'. Did you mean '4dgs'"),
        ({"minutes": 1.0}, "minutes=1.0 and steps=4: a run ends after a time or"),
        ({"preset": "fasst"}, "has no preset 'fasst'. Did you mean 'fast'"),
        ({"seed": -1}, "seed=-1: expected a number"),
        ({"callbacks": [object()]}, "expected a list of gsfw.api.Callback"),
        ({"callbacks": [Callback]}, "expected a list of gsfw.api.Callback"),
        ({"callbacks": Callback()}, "expected a list of gsfw.api.Callback"),
    ],
)
def test_wrong_settings_are_refused_as_by_the_verb(given, message, tmp_path):
    with pytest.raises(ConfigError) as caught:
        train(**{"method": "3dgs", "steps": 4, "progress": False, **given})
    assert message in str(caught.value)
    assert traceback.extract_tb(caught.tb)[-1].name == "called", "no inner frames are shown"
    assert list(tmp_path.iterdir()) == []


def test_missing_data_and_missing_runs_are_refused(finished_run, tmp_path):
    with pytest.raises(DataError, match="data=nowhere: there is no such file or folder"):
        train(method="3dgs", data="nowhere", progress=False)
    with pytest.raises(DataError, match="there is no run or splat file nothing"):
        open_run("nothing")
    with pytest.raises(ConfigError, match=r"is a model and no run.*\n.*gsfw.load\("):
        open_run(finished_run / "splats.ply")
    with pytest.raises(ConfigError, match="seed cannot change when a run is resumed"):
        open_run(finished_run).resume(settings={"seed": 3}, progress=False)


@pytest.mark.slow
def test_a_run_trains_to_its_end_with_the_bits_of_the_verb(tmp_path, capsys):
    quick(steps=1, out="first")  # Libraries that it imports add filters of warnings.
    capsys.readouterr()
    before = states()
    run = quick(steps=6, settings={"callbacks.tensorboard.enabled": False})
    assert capsys.readouterr() == ("", "")
    assert states() == before
    assert (run.steps, run.is_finished) == (6, True)
    words = (*SMALL_SCENE, "steps=6", "report=false", "callbacks.tensorboard.enabled=false")
    assert main(["train", "method=3dgs", *words, "out=verb"]) == 0
    assert (run.folder / "splats.ply").read_bytes() == Path("verb/splats.ply").read_bytes()
    assert (
        "command line: gsfw train method=3dgs out=run steps=6"
        in (run.folder / "config.yaml").read_text()
    )


@pytest.mark.slow
def test_runs_in_threads_have_equal_bits_and_leave_nothing_behind(tmp_path):
    before, others = states(), set(threading.enumerate())  # Those of runs that are open still.
    with ThreadPoolExecutor(2) as pool:
        runs = list(pool.map(lambda name: quick(out=name), ["first", "second"]))
    third = quick(out="third")
    contents = {(run.folder / "splats.ply").read_bytes() for run in (*runs, third)}
    assert len(contents) == 1
    assert states() == before
    left = set(threading.enumerate()) - others
    assert [thread.name for thread in left if "gsfw" in thread.name] == []
    assert quick(out="other", seed=7).metrics["psnr"] != third.metrics["psnr"]


@pytest.mark.slow
def test_an_interrupted_run_keeps_a_checkpoint_and_goes_on_with_the_same_bits(tmp_path):
    whole = quick()
    with pytest.raises(
        KeyboardInterrupt, match=r"stopped has a checkpoint; continue with: gsfw.open"
    ):
        quick(out="stopped", callbacks=[StopAt(9)])
    run = open_run("stopped")
    assert (run.steps, run.is_finished, dict(run.metrics)) == (9, False, {})
    assert "9 of 20 steps" in run._repr_html_()
    done = run.resume(progress=False)
    assert (done.steps, done.is_finished) == (20, True)
    assert (done.folder / "splats.ply").read_bytes() == (whole.folder / "splats.ply").read_bytes()
    longer = done.resume(steps=24, progress=False)
    assert (longer.steps, longer.settings["steps"]) == (24, 24)


@pytest.mark.slow
def test_progress_of_a_script_is_on_standard_error(tmp_path, capsys):
    train(method="3dgs", steps=20, out="run", settings=SMALL)
    out, err = capsys.readouterr()
    assert out == ""
    assert "preparing method 3dgs on the built-in scene, device auto" in err
    assert "100%  20/20" in err
    assert "done: 3dgs on synthetic, 20 steps" in err
    assert "gsfw view run" in err


def test_a_setting_given_as_an_argument_is_told_where_it_belongs(finished_run, tmp_path):
    with pytest.raises(ConfigError) as caught:
        train(method="3dgs", steps=9, downscale=4, **{"strategy.cap_max": 10})
    assert str(caught.value) == (
        "train has no argument 'downscale'.\n"
        "If downscale is a setting, write settings={'downscale': 4, 'strategy.cap_max': 10}."
    )
    assert isinstance(caught.value, TypeError), "as Python's own error for such a call"
    with pytest.raises(ConfigError, match=r"train has no argument 'step'\. Did you mean 'steps'"):
        train(method="3dgs", step=9)
    with pytest.raises(ConfigError, match=r"write settings=\{'log_every': 1\}"):
        open_run(finished_run).resume(log_every=1)
    with pytest.raises(TypeError, match="missing 1 required keyword-only argument: 'method'"):
        train(steps=9)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_time_is_planned_as_by_the_verb(tmp_path):
    with pytest.raises(ConfigError, match=r"minutes=0.001: that is 0 s, and "):
        train(method="3dgs", minutes=0.001, settings=SMALL, out="timed", progress=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_moving_model_renders_at_the_times_of_its_cameras(tmp_path):
    moving = {**SMALL, "datamanager.moving": True, "datamanager.times": 3, "report": False}
    run = train(method="4dgs", steps=4, out="moving", progress=False, settings=moving)
    cameras = run.model.camera_path("time", frames=3)
    together = run.render(cameras).color
    for index, time in enumerate((0.0, 0.5, 1.0)):
        alone = run.render(cameras.select([0]), time=time).color
        torch.testing.assert_close(alone[0], together[index])


def test_a_run_that_was_used_crosses_to_another_process():
    run = quick(2)
    assert run.model.num_gaussians
    arrived = pickle.loads(pickle.dumps(run))
    assert (arrived.folder, arrived.metrics) == (run.folder, run.metrics)


def test_a_model_crosses_to_another_process_with_its_checkpoint(monkeypatch, tmp_path):
    run = quick(4, settings={"checkpoint_every": 2})
    model = Run(run.folder, run.folder / "checkpoints" / "step_000000002.pt").model
    camera = model.cameras()[0]
    for source in (model, run.model):
        bytes_of_it = pickle.dumps(source)
        with monkeypatch.context() as changed:
            changed.chdir(tmp_path.parent)
            arrived = pickle.loads(bytes_of_it)
        assert torch.equal(arrived.render(camera).color, source.render(camera).color)
        assert arrived.method == source.method
