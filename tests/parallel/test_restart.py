"""torchrun starts the processes again after one was killed, and the run goes on."""

import os
import signal

import pytest
from support.processes import TORCHRUN, Training, ended, last_step, needs_proc

from gsfw.core.loop.run_folder import RunFolder

pytestmark = [pytest.mark.slow, needs_proc]


def test_processes_that_torchrun_starts_again_go_on_from_the_last_checkpoint(tmp_path):
    training = Training(tmp_path, launcher=(*TORCHRUN, "--max-restarts=1"))
    before = last_step(training.folder)
    os.kill(training.workers()["1"], signal.SIGKILL)
    training.wait_for(lambda: "continuing after step" in training.said)
    training.wait_for(lambda: last_step(training.folder) > before + 20)
    assert f"the processes were started again: continuing {training.folder}" in training.said
    again = int(training.said.split("continuing after step ")[1].split()[0])
    assert again >= before
    for pid in training.workers().values():  # No restart is left.
        os.kill(pid, signal.SIGKILL)
    code, said = training.ended()
    assert code == 1
    assert "holds a run already" not in said


def test_a_run_that_another_command_has_made_is_refused_in_every_start(tmp_path):
    run = RunFolder(tmp_path / "run")
    run.path.mkdir()
    run.config.write_text("method: 3dgs\n")
    words = ("-m", "gsfw", "train", "method=3dgs", "steps=9", f"out={run.path}")
    done = ended((*TORCHRUN, "--max-restarts=1", *words))
    assert done.returncode == 1
    assert done.stderr.count("this folder holds a run already") == 2
    assert [path.name for path in run.path.iterdir()] == ["config.yaml"]
