"""The disk of the run is full while processes train."""

import os
import subprocess

import pytest
from support.processes import LONG, ONE_THREAD, command, last_step

from gsfw.commands.main import main

pytestmark = [pytest.mark.slow, pytest.mark.skipif(os.name == "nt", reason="mounts a disk")]


def test_a_full_disk_ends_all_processes_and_the_last_checkpoint_goes_on(tmp_path, tiny_disk):
    run = tiny_disk / "run"  # Three checkpoints are more than the disk holds.
    done = subprocess.run(
        command("train", *LONG, "processes=2", f"out={run}"),
        check=False, capture_output=True, text=True, env=ONE_THREAD, timeout=120,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("error:") == 1
    assert f"error: the disk is full: {run}" in done.stderr
    assert "Traceback" not in done.stderr
    steps = last_step(run)
    assert steps >= 10
    assert not list(run.glob("checkpoints/.*"))
    subprocess.run(["mount", "-o", "remount,size=8m", str(tiny_disk)], check=True)
    assert main(["resume", str(run), f"steps={steps + 5}", "processes=1"]) == 0
    assert last_step(run) == steps + 5
