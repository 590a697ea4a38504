"""Real processes that train together: command lines, their signals, and what they print."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from support.states import without_clock

SCENE = (
    *("device=cpu", "datamanager.views=8", "datamanager.width=48", "datamanager.height=36"),
    *("datamanager.points=500", "datamanager.eval_views=2", "report=false", "eval_every=0"),
    "sampler.views_per_step=4",
)


def refined(every: int) -> tuple[str, str]:
    """Settings of a strategy that edits rows at these steps, from the first one on."""
    return f"strategy.refine_start={every}", f"strategy.refine_every={every}"


LONG = ("method=3dgs", *SCENE, *refined(20), "steps=100000", "rescale=false", "checkpoint_every=10")
"""A training that does not end by itself."""
ONE_THREAD = {**os.environ, "OMP_NUM_THREADS": "1"}
TORCHRUN = (sys.executable, "-m", "torch.distributed.run", "--nproc-per-node=2", "--standalone")

needs_proc = pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="no /proc here")


def command(verb: str, *words: str) -> list[str]:
    """A command line of gsfw."""
    return [sys.executable, "-m", "gsfw", verb, *words]


def ended(arguments: Sequence[str]) -> subprocess.CompletedProcess:
    """Run a command to its end."""
    return subprocess.run(
        arguments, check=False, capture_output=True, text=True, env=ONE_THREAD, timeout=300
    )


def finished(arguments: Sequence[str]) -> subprocess.CompletedProcess:
    """Run a command that has to succeed."""
    done = ended(arguments)
    assert done.returncode == 0, done.stderr
    return done


def last_step(folder: Path) -> int:
    """Step of the last checkpoint of a run, which is read."""
    latest = RunFolder(folder).latest_checkpoint()
    assert latest is not None
    return read_checkpoint(latest)["step"]


def state(folder: Path) -> dict:
    """The last checkpoint of a run without its times."""
    latest = RunFolder(folder).latest_checkpoint()
    assert latest is not None
    return without_clock(read_checkpoint(latest))


class Started:
    """A started command, and what it prints."""

    def __init__(self, arguments: Sequence[str], said: Path, **variables: str) -> None:
        self._said = said
        with said.open("w") as file:
            self.process = subprocess.Popen(
                arguments, stdout=file, stderr=file, env={**ONE_THREAD, **variables}
            )

    @property
    def said(self) -> str:
        """All that it has printed."""
        return self._said.read_text()

    def wait_for(self, holds: Callable[[], bool], seconds: float = 120.0) -> None:
        """Wait until a condition holds, while the command runs."""
        until = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < until, self.said
            assert self.process.poll() is None, self.said
            time.sleep(0.05)

    def ended(self, seconds: float = 60.0) -> tuple[int, str]:
        """Wait for its end; the exit code, and all that it has printed."""
        return self.process.wait(seconds), self.said


class Training(Started):
    """A long training of two processes that has written the checkpoint of step 20."""

    def __init__(
        self, place: Path, folder: Path | None = None, launcher: Sequence[str] = ()
    ) -> None:
        self.folder = folder or place / "run"
        run = RunFolder(self.folder)
        train = ("train", *LONG, f"out={self.folder}")
        line = (*launcher, "-m", "gsfw", *train) if launcher else command(*train, "processes=2")
        super().__init__(line, place / "said.txt")
        self.wait_for(lambda: (run.latest_checkpoint() or run.path).name >= run.checkpoint(20).name)

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
