"""Real processes: the command line, torchrun, signals and lost processes."""

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest
from support.processes import (
    ONE_THREAD,
    SCENE,
    TORCHRUN,
    Training,
    command,
    finished,
    last_step,
    needs_proc,
    state,
)
from support.states import assert_same_bits

from gsfw.core.loop.run_folder import RunFolder

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="POSIX signals")]

METHODS = {
    "adc": ("method=3dgs",),
    "mcmc": ("method=3dgs", "strategy=mcmc", "strategy.cap_max=800"),
    "spacetime": ("method=spacetime", "datamanager.moving=true", "datamanager.times=4"),
}


def rows(folder: Path) -> int:
    """Number of rows of a model; 500 at the start."""
    return next(len(v) for k, v in state(folder)["model"].items() if k.endswith("means.values"))


def train(
    method: str,
    out: Path,
    processes: int,
    launcher: tuple[str, ...] = (),
    shards: int = 0,
    steps: int = 200,
) -> str:
    """Train by some processes; returns what was printed."""
    words = ("train", *METHODS[method], *SCENE, f"steps={steps}", f"shards={shards}")
    words += (f"checkpoint_every={steps // 2}", f"out={out}")
    if launcher:
        return finished((*launcher, "-m", "gsfw", *words)).stdout
    return finished(command(*words, f"processes={processes}")).stdout


@pytest.fixture(scope="module")
def alone(tmp_path_factory) -> Path:
    """A run of one process."""
    folder = tmp_path_factory.mktemp("alone") / "run"
    train("adc", folder, 1)
    assert rows(folder) > 500, "refiners have edited rows"
    return folder


@pytest.mark.parametrize("method", ["mcmc", "spacetime"])
def test_one_and_four_processes_train_the_same_bits(tmp_path, method):
    train(method, tmp_path / "1", 1)
    assert rows(tmp_path / "1") > 500
    train(method, tmp_path / "4", 4)
    assert_same_bits(state(tmp_path / "4"), state(tmp_path / "1"))


@pytest.mark.parametrize("method", METHODS)
def test_processes_that_share_the_gaussians_train_the_bits_of_one(tmp_path, method):
    one, four = RunFolder(tmp_path / "1"), RunFolder(tmp_path / "4")
    train(method, one.path, 1, shards=4, steps=100)
    assert rows(one.path) > 500
    assert "4 processes" in train(method, four.path, 4, shards=4, steps=100)
    assert_same_bits(state(four.path), state(one.path))
    four.checkpoint(100).unlink()
    four.summary.unlink()
    finished(command("resume", str(four.path), "processes=2"))
    assert_same_bits(state(four.path), state(one.path))


def test_four_processes_train_the_bits_of_one(tmp_path, alone):
    train("adc", tmp_path / "4", 4)
    assert_same_bits(state(tmp_path / "4"), state(alone))


def test_a_run_of_torchrun_goes_on_with_another_number_of_processes(tmp_path, alone):
    two = RunFolder(tmp_path / "two")
    said = train("adc", two.path, 2, TORCHRUN)
    assert said.count("method 3dgs") == 1, "the first process alone prints"
    assert "2 processes for 4 views of a step" in said
    assert_same_bits(state(two.path), state(alone))
    two.checkpoint(200).unlink()
    two.summary.unlink()
    finished(command("resume", str(two.path), "processes=3"))
    assert_same_bits(state(two.path), state(alone))


@needs_proc
def test_a_pause_loses_nothing_a_second_command_is_refused_and_ctrl_c_stops_with_a_checkpoint(
    tmp_path,
):
    training = Training(tmp_path)
    slow = training.workers()["1"]
    os.kill(slow, signal.SIGSTOP)
    time.sleep(1)  # Until the other process waits for it.
    latest = RunFolder(training.folder).latest_checkpoint
    before = latest()
    second = subprocess.run(
        command("resume", str(training.folder), "processes=0"),
        check=False, capture_output=True, text=True, env=ONE_THREAD, timeout=120,
    )  # fmt: skip
    assert second.returncode == 2
    assert "another gsfw train or resume" in second.stderr
    assert training.process.poll() is None
    assert latest() == before
    os.kill(slow, signal.SIGCONT)
    training.wait_for(lambda: latest() != before)
    training.process.send_signal(signal.SIGINT)
    code, said = training.ended()
    assert code == 130
    assert said.count("stopping after this step, with a checkpoint") == 1
    assert "Go on with: gsfw resume" in said
    assert "error" not in said
    assert "Traceback" not in said
    assert not training.workers()


@needs_proc
@pytest.mark.parametrize("rank", ["0", "1"])
def test_a_killed_process_ends_the_others_and_the_checkpoint_goes_on(tmp_path, rank):
    training = Training(tmp_path)
    os.kill(training.workers()[rank], signal.SIGKILL)
    code, said = training.ended()
    assert code == 1
    assert f"process {rank} was ended by SIGKILL (memory may have run out)" in said
    assert "Traceback" not in said
    assert not training.workers()
    steps = last_step(training.folder)
    finished(command("resume", str(training.folder), f"steps={steps + 5}", "processes=1"))


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("method=3dgs", "minutes=3"), "processes=2 and minutes=: runs of several processes end"),
        (("method=3dgs", "data=/nothing", "steps=9"), "data=/nothing: there is no such file"),
        (("method=3dgs", "sh=adaptive", "steps=9"), r"\(bands\) watches the backward pass"),
        (("method=3dgs", "shards=1", "steps=9"), "2 processes, more than shards"),
        (("method=3dgs", "shards=2", "strategy=error", "steps=9"), "watches the backward pass"),
        (("method=3dgs", "shards=2", "viewer=true", "steps=9"), "viewer"),
        (("method=4d-rotor", "shards=2", "datamanager.moving=true", "steps=9"), "other rows"),
    ],
)
def test_mistakes_have_one_message(tmp_path, words, sentence):
    done = subprocess.run(
        command("train", *words, "processes=2", f"out={tmp_path / 'run'}"),
        check=False, capture_output=True, text=True, env=ONE_THREAD, timeout=120,
    )  # fmt: skip
    assert done.returncode == 2
    assert len(re.findall("error:", done.stderr)) == 1
    assert re.search(sentence, done.stderr), done.stderr
    assert not (tmp_path / "run").exists()
