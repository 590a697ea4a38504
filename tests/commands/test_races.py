"""Runs that are started at one instant in one folder."""

import json
import shutil
import subprocess
import sys
import time

import pytest
from support.small_scene import SMALL_SCENE

from gsfw.core.loop.run_folder import RunFolder

STARTER = """
import sys, time
from gsfw.commands.main import main
from gsfw.plugins.compose import compose
import gsfw.commands.interface.training
print("ready", flush=True)
start = float(sys.stdin.readline())
while time.time() < start: pass
sys.exit(main(sys.argv[1:]))
"""
"""A command that begins at a given time, with all that it takes to begin loaded."""


def started_at_once(tmp_path, *arguments: str) -> list[tuple[int, str]]:
    """Exit codes and messages of two processes of one command, the successful first."""
    command = [sys.executable, "-c", STARTER, *arguments]
    pipe = subprocess.PIPE
    racers = [
        subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, cwd=tmp_path)
        for _ in range(2)
    ]
    for racer in racers:
        assert racer.stdout is not None
        assert racer.stdout.readline() == "ready\n"
    start = f"{time.time() + 0.05}\n"
    said = []
    for racer in racers:
        assert racer.stdin is not None
        racer.stdin.write(start)
        racer.stdin.flush()
    for racer in racers:
        _, errors = racer.communicate()
        said.append((racer.returncode, errors))
    return sorted(said)


def assert_log_of_one_run(folder: RunFolder) -> None:
    """Check that steps ascend; only the last has two lines, the second with the evaluation."""
    lines = folder.metrics_log.read_text().splitlines()
    steps = [json.loads(line)["step"] for line in lines]
    assert steps == sorted(steps)
    assert steps.count(30) == 1


@pytest.mark.slow
def test_of_two_trainings_in_one_folder_one_trains_and_the_other_says_why_not(tmp_path):
    trained, refused = started_at_once(
        tmp_path, "train", "method=3dgs", *SMALL_SCENE, "steps=60", "device=cpu", "out=a/run"
    )
    assert (trained[0], refused[0]) == (0, 2)
    assert "another gsfw train or resume is at work there (process " in refused[1] or (
        "this folder holds a run already" in refused[1]
    )
    assert_log_of_one_run(RunFolder(tmp_path / "a" / "run"))
    assert json.loads(RunFolder(tmp_path / "a" / "run").summary.read_text())["completed"]


@pytest.mark.slow
def test_of_two_trainings_without_out_each_gets_a_folder(tmp_path):
    codes = [
        code
        for code, _ in started_at_once(
            tmp_path, "train", "method=3dgs", *SMALL_SCENE, "steps=4", "device=cpu"
        )
    ]
    assert codes == [0, 0]
    assert len(list(tmp_path.glob("runs/*/3dgs/*/splats.ply"))) == 2


@pytest.mark.slow
def test_of_two_processes_that_go_on_with_one_run_one_does(tmp_path, finished_run):
    shutil.copytree(finished_run, tmp_path / "run")
    went_on, refused = started_at_once(tmp_path, "resume", "run", "steps=60")
    assert went_on[0] == 0
    # Whoever comes after the end finds the run finished, which is as right.
    assert refused[0] == 0 or (
        refused[0] == 2
        and "run: another gsfw train or resume is at work there (process " in refused[1]
        and "Wait for it, or end it." in refused[1]
    )
    assert_log_of_one_run(RunFolder(tmp_path / "run"))
