"""Real processes: the command line, torchrun, signals and lost processes."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.states import assert_same_bits

from gsfw.core.loop.run_folder import RunFolder, read_checkpoint

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="POSIX signals")]

SCENE = (
    *("device=cpu", "datamanager.views=8", "datamanager.width=48", "datamanager.height=36"),
    *("datamanager.points=500", "datamanager.eval_views=2", "report=false", "eval_every=0"),
    *("sampler.views_per_step=4", "strategy.refine_start=20", "strategy.refine_every=20"),
)
METHODS = {
    "adc": ("method=3dgs",),
    "mcmc": ("method=3dgs", "strategy=mcmc", "strategy.cap_max=800"),
    "spacetime": ("method=spacetime", "datamanager.moving=true", "datamanager.times=4"),
}
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1"}


def command(verb: str, *words: str) -> list[str]:
    return [sys.executable, "-m", "gsfw", verb, *words]


def finished(arguments: list[str]) -> subprocess.CompletedProcess:
    done = subprocess.run(
        arguments, check=False, capture_output=True, text=True, env=ONE_THREAD, timeout=300
    )
    assert done.returncode == 0, done.stderr
    return done


def state(folder: Path) -> dict:
    latest = RunFolder(folder).latest_checkpoint()
    assert latest is not None
    return {k: v for k, v in read_checkpoint(latest).items() if k != "train_seconds"}


@pytest.mark.parametrize("method", METHODS)
def test_one_two_and_four_processes_train_the_same_bits(tmp_path, method):
    for number in (1, 2, 4):
        words = (*METHODS[method], *SCENE, "steps=200", f"processes={number}")
        finished(command("train", *words, f"out={tmp_path / str(number)}"))
    for number in (2, 4):
        assert_same_bits(state(tmp_path / str(number)), state(tmp_path / "1"))


def test_a_run_of_torchrun_goes_on_with_another_number_of_processes(tmp_path):
    train = ("train", "method=3dgs", *SCENE, "steps=60", "checkpoint_every=30")
    finished(command(*train, "processes=1", f"out={tmp_path / 'one'}"))
    torchrun = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node=2", "--standalone"]
    done = finished([*torchrun, "-m", "gsfw", *train, f"out={tmp_path / 'two'}"])
    assert done.stdout.count("method 3dgs") == 1, "the first process alone prints"
    assert "2 processes for 4 views of a step" in done.stdout
    two = RunFolder(tmp_path / "two")
    two.checkpoint(60).unlink()
    two.summary.unlink()
    finished(command("resume", str(two.path), "processes=3"))
    assert_same_bits(state(tmp_path / "two"), state(tmp_path / "one"))


class Training:
    """A long training of two processes, and what it prints."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.said = folder / "run", folder / "said.txt"
        words = ("method=3dgs", *SCENE, "steps=100000", "rescale=false", "checkpoint_every=10")
        with self.said.open("w") as said:
            self.process = subprocess.Popen(
                command("train", *words, "processes=2", f"out={self.folder}"),
                stdout=said, stderr=said, env=ONE_THREAD,
            )  # fmt: skip
        self.wait_for(lambda: RunFolder(self.folder).checkpoint(20).is_file())

    def wait_for(self, holds, seconds: float = 120.0) -> None:
        until = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < until, self.said.read_text()
            time.sleep(0.05)

    def workers(self) -> dict[str, int]:
        """Process numbers of the system by rank."""
        found = {}
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                line, variables = (entry / "cmdline").read_text(), (entry / "environ").read_text()
            except OSError:
                continue
            rank = re.search(r"(?:^|\0)RANK=(\d+)", variables)
            if f"out={self.folder}" in line and rank:
                found[rank[1]] = int(entry.name)
        return found

    def ended(self) -> tuple[int, str]:
        return self.process.wait(60), self.said.read_text()


needs_proc = pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="no /proc here")


@needs_proc
def test_ctrl_c_stops_all_processes_after_the_same_step_with_a_checkpoint(tmp_path):
    training = Training(tmp_path)
    training.process.send_signal(signal.SIGINT)
    code, said = training.ended()
    assert code == 130
    assert said.count("stopping after this step, with a checkpoint") == 1
    assert "Go on with: gsfw resume" in said
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
    steps = read_checkpoint(RunFolder(training.folder).latest_checkpoint())["step"]
    resumed = command("resume", str(training.folder), f"steps={steps + 5}", "processes=2")
    finished(resumed)


@needs_proc
def test_a_paused_process_delays_the_others_and_nothing_is_lost(tmp_path):
    training = Training(tmp_path)
    slow = training.workers()["1"]
    os.kill(slow, signal.SIGSTOP)
    time.sleep(3)
    assert training.process.poll() is None
    os.kill(slow, signal.SIGCONT)
    latest = RunFolder(training.folder).latest_checkpoint
    before = latest()
    training.wait_for(lambda: latest() != before)
    training.process.send_signal(signal.SIGTERM)
    code, said = training.ended()
    assert code == 130
    assert "error" not in said


@needs_proc
def test_two_runs_to_one_folder_are_refused(tmp_path):
    training = Training(tmp_path)
    second = subprocess.run(
        command("resume", str(training.folder), "processes=2"),
        check=False, capture_output=True, text=True, env=ONE_THREAD, timeout=120,
    )  # fmt: skip
    assert second.returncode == 2
    assert "another gsfw train or resume" in second.stderr
    training.process.send_signal(signal.SIGTERM)
    training.ended()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("method=3dgs", "minutes=3"), "processes=2 and minutes=: runs of several processes end"),
        (("method=3dgs", "data=/nothing", "steps=9"), "data=/nothing: there is no such file"),
        (("method=3dgs", "sh=adaptive", "steps=9"), r"\(bands\) watches the backward pass"),
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
