"""Training under a limit of memory: real control groups, and what the user reads."""

import os
import signal
import subprocess
import sys

import pytest
from memory_limit import memory_limit
from support.small_scene import SMALL_SCENE

from gsfw.commands.main import main
from gsfw.core.machine_memory import Limit, MachineMemory
from gsfw.plugins import memory_fit

WORDS = ("method=3dgs", "device=cpu", *SMALL_SCENE, "steps=2", "report=false")


def test_a_run_that_cannot_fit_ends_with_a_sentence_and_leaves_no_folder(
    tmp_path, capsys, monkeypatch
):
    little = MachineMemory(180_000_000, 180_000_000, limit=Limit.GROUP)
    monkeypatch.setattr(memory_fit, "process_memory", lambda: little)
    for more in ((), ("--dry-run",)):
        assert main(["train", *WORDS, f"out={tmp_path / 'run'}", *more]) == 2
        assert capsys.readouterr().err.endswith(
            "error: training needs about 293 MB of memory for 150 Gaussians to start with, and "
            "the control group of this process allows 180 MB.\n"
            "check_memory=false trains all the same.\n"
        )
    assert not (tmp_path / "run").exists()


def test_an_ordinary_run_says_nothing_of_memory(tmp_path, capsys):
    assert main(["train", *WORDS, f"out={tmp_path / 'run'}"]) == 0
    said = capsys.readouterr()
    assert "memory may" not in said.out + said.err
    assert "decoded images" not in said.out + said.err


@pytest.mark.slow
def test_in_a_real_control_group_large_runs_are_refused_and_small_ones_train(tmp_path):
    def train(points: int) -> subprocess.CompletedProcess:
        with memory_limit(500) as limit:
            if "control group" not in limit.name:
                pytest.skip("no control group can be made here")
            return subprocess.run(
                [sys.executable, "-m", "gsfw", "train", *WORDS, f"datamanager.points={points}",
                 f"out={tmp_path / str(points)}"],
                preexec_fn=limit.enter, env=os.environ | {"OMP_NUM_THREADS": "1"},
                capture_output=True, text=True, check=False,
            )  # fmt: skip

    refused = train(300_000)
    assert refused.returncode == 2, refused.stderr
    assert "error: training needs about 716 MB of memory for 300,000 Gaussians" in refused.stderr
    assert "the control group of this process allows 500 MB" in refused.stderr
    trained = train(20_000)
    assert trained.returncode == 0, trained.stderr


@pytest.mark.slow
def test_in_a_real_control_group_a_growing_run_ends_in_words_where_it_would_be_killed(tmp_path):
    grows = (
        *(word for word in WORDS if not word.startswith("steps=")),
        *("steps=80", "strategy.refine_start=10", "strategy.refine_every=10"),
        *("strategy.refine_stop=80", "strategy.grow_gradient=1e-9", "strategy.reset_every=0"),
        *("strategy.max_gaussians=0", "datamanager.points=20000", "eval_every=0"),
    )

    def train(name: str, *more: str, megabytes: int = 600) -> subprocess.CompletedProcess:
        with memory_limit(megabytes) as limit:
            if "control group" not in limit.name:
                pytest.skip("no control group can be made here")
            return subprocess.run(
                [sys.executable, "-m", "gsfw", "train", *grows, f"out={tmp_path / name}", *more],
                preexec_fn=limit.enter, env=os.environ | {"OMP_NUM_THREADS": "1"},
                capture_output=True, text=True, check=False,
            )  # fmt: skip

    watched = train("watched")
    assert "memory runs short" in watched.stderr
    assert watched.returncode in (0, 2), watched.stderr  # Trained, or ended with a checkpoint.
    assert watched.returncode == 0 or "is kept: gsfw resume" in watched.stderr
    assert train("unwatched", "check_memory=false").returncode == -signal.SIGKILL
    both = train("both", "sampler.views_per_step=2", "processes=2", megabytes=1400)
    assert both.stderr.count("growth slows down") == 1
    assert both.returncode in (0, 2), both.stderr
