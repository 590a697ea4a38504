"""Real processes: the command line, torchrun, signals and lost processes."""

import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from support.processes import (
    LONG,
    ONE_THREAD,
    SCENE,
    TORCHRUN,
    Started,
    Training,
    command,
    finished,
    last_step,
    needs_proc,
    refined,
    state,
)
from support.states import assert_same_bits

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.plugin_path import VARIABLE

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="POSIX signals")]

METHODS = {
    "adc": ("method=3dgs",),
    "spacetime": ("method=spacetime", "datamanager.moving=true", "datamanager.times=4"),
}

STEPS = 40
"""Refiners edit rows before and after the checkpoint in the middle."""


def rows(folder: Path) -> int:
    """Number of rows of a model; 500 at the start."""
    return next(len(v) for k, v in state(folder)["model"].items() if k.endswith("means.values"))


def words(method: str, shards: int = 0) -> tuple[str, ...]:
    """Settings of a run, but for its folder and its processes."""
    every = (f"steps={STEPS}", "rescale=false", f"checkpoint_every={STEPS // 2}")
    return (*METHODS[method], *SCENE, *refined(10), *every, f"shards={shards}")


@pytest.fixture(autouse=True)
def undisturbed(monkeypatch) -> Iterator[None]:
    """Give workers one thread; undo the handlers of signals that torch's launcher sets here."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT
    handlers = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, handlers, strict=True):
        signal.signal(number, handler)


@pytest.fixture(scope="module")
def alone(trained) -> Callable[..., dict]:
    """Gives the last checkpoint of a run of one process: this one."""

    def run(method: str, shards: int = 0) -> dict:
        folder = trained(*words(method, shards), "processes=1")
        assert rows(folder) > 500, "refiners have edited rows"
        return state(folder)

    return run


def go_on(run: RunFolder, processes: int) -> None:
    """Resume a finished run from the checkpoint in its middle."""
    run.checkpoint(STEPS).unlink()
    run.summary.unlink()
    assert main(["resume", str(run.path), f"processes={processes}"]) == 0


# Threads train other strategies in test_data_parallel.py and test_gaussian_parallel.py.


def test_several_processes_train_the_bits_of_one(tmp_path, alone):
    out = tmp_path / "run"
    assert main(["train", *words("spacetime"), "processes=3", f"out={out}"]) == 0
    assert_same_bits(state(out), alone("spacetime"))


@pytest.mark.parametrize("method", METHODS)
def test_processes_that_share_the_gaussians_train_the_bits_of_one(tmp_path, capfd, alone, method):
    run, size = RunFolder(tmp_path / "run"), 4 if method == "adc" else 3
    arguments = (*words(method, shards=4), f"processes={size}", f"out={run.path}")
    assert main(["train", *arguments]) == 0
    assert f"{size} processes that share the Gaussians" in capfd.readouterr().out
    assert_same_bits(state(run.path), alone(method, 4))
    if method == "spacetime":
        go_on(run, 2)
        assert_same_bits(state(run.path), alone(method, 4))


def test_a_run_of_torchrun_goes_on_with_another_number_of_processes(tmp_path, alone):
    two = RunFolder(tmp_path / "two")
    arguments = ("train", *words("adc"), f"out={two.path}")
    said = finished((*TORCHRUN, "-m", "gsfw", *arguments)).stdout
    assert said.count("method 3dgs") == 1, "the first process alone prints"
    assert "2 processes for 4 views of a step" in said
    assert_same_bits(state(two.path), alone("adc"))
    go_on(two, 3)
    assert_same_bits(state(two.path), alone("adc"))


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
    assert "Continue with: gsfw resume" in said
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
    assert main(["resume", str(training.folder), f"steps={steps + 5}", "processes=1"]) == 0


FAILING = """
import os
from dataclasses import dataclass

from gsfw.api import Spec, hookimpl
from gsfw.samplers.uniform import UniformConfig, UniformSampler


@hookimpl
def gsfw_samplers():
    return [Spec("failing", "A sampler that fails in one process.", f"{__name__}:FailingConfig")]


@dataclass
class FailingConfig(UniformConfig):
    def build(self, views, seed, steps):
        return Failing(len(views), self.views_per_step, seed)


class Failing(UniformSampler):
    def next(self):
        if os.environ.get("RANK") == os.environ["FAILS"] and self._position == 4 * 25:
            raise IndexError("a bug")
        return super().next()
"""


def test_a_bug_in_one_of_three_processes_that_share_the_gaussians_loses_no_finished_step(
    tmp_path, plugin_path, monkeypatch
):
    plugin, run = tmp_path / "failing_plugin.py", RunFolder(tmp_path / "run")
    plugin.write_text(FAILING)
    monkeypatch.setenv("FAILS", "none")
    plugin_path(plugin)
    variables = {"FAILS": "1", VARIABLE: str(plugin)}
    words = ("sampler=failing", "shards=3", "processes=3", f"out={run.path}")
    training = Started(command("train", *LONG, *words), tmp_path / "said.txt", **variables)
    code, said = training.ended(120.0)
    assert code == 1
    assert said.count("IndexError: a bug") == 1
    kept = run.checkpoint(25)
    assert f"{kept} has the state after 25 steps" in said
    assert last_step(run.path) == 25
    assert rows(run.path) >= 500
    assert main(["resume", str(run.path), "steps=28", "processes=2"]) == 0


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("method=3dgs", "minutes=3"), "processes=2 and minutes=: runs of several processes end"),
        (("method=3dgs", "data=/nothing", "steps=9"), "data=/nothing: there is no such file"),
        (("method=3dgs", "shards=2", "viewer=true", "steps=9"), "viewer"),
        (("method=3dgs", "sh=adaptive", "steps=9"), "backward pass"),
        # test_gaussian_parallel.py and test_data_parallel.py have the other refusals of teams.
        (("method=4d-rotor", "shards=2", "datamanager.moving=true", "steps=9"), "other rows"),
    ],
)
def test_mistakes_have_one_message(tmp_path, capfd, words, sentence):
    assert main(["train", *words, "processes=2", f"out={tmp_path / 'run'}"]) == 2
    said = capfd.readouterr().err
    assert len(re.findall("error:", said)) == 1
    assert re.search(sentence, said), said
    assert not (tmp_path / "run").exists()
