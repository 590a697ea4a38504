"""Fixtures that several folders of tests share."""

import gc
import signal
import subprocess
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import jaxtyping
import pytest
import torch

from gsfw.commands import progress
from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets, native

# The scenes of tests are small: a second thread gains nothing, and where cores are busy it costs
# several times the work in waiting. Tests of repeatability with threads start their own processes.
torch.set_num_threads(1)

# What a shell starts in the background ignores SIGINT, and so would all that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests compare standard error, on machines that are slow enough to make any stage a slow one.
progress.PATIENCE = 1e6

WHOLE_RUNS = ("commands", "plugins")
"""Folders whose tests are of runs as a whole, not of the parts that these are made of."""

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

SMALL_SCENE = (
    "datamanager.views=6",
    "datamanager.eval_views=2",
    "datamanager.width=32",
    "datamanager.height=24",
    "datamanager.points=150",
)
"""The built-in scene at a size that trains in a second."""


def pytest_collection_finish() -> None:
    """Thousands of tests stay until the end: the garbage collector need not look at them again."""
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    """Check shapes at every call, unless whole runs are made.

    These go thousands of times through what the tests of the parts have checked, and would take two
    to three times as long.
    """
    marks = {mark.name for mark in item.iter_markers()}
    whole = item.path.parent.name in WHOLE_RUNS or bool(marks & {"slow", "unchecked"})
    jaxtyping.config.update("jaxtyping_disable", whole)
    return (yield)


@pytest.fixture
def shared_data() -> Path:
    """Real captures beside the checkout; tests that use them skip where there are none."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the folder of real captures (../shared/data) is not on this machine")
    return SHARED_DATA


@pytest.fixture
def tiny_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 1 MiB; skips where mounting is not allowed."""
    mount = tmp_path / "disk"
    mount.mkdir()
    mounting = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(mount)]
    if subprocess.run(mounting, capture_output=True, check=False).returncode:
        pytest.skip("mounting a size-limited tmpfs needs root")
    yield mount
    subprocess.run(["umount", str(mount)], check=True)


@pytest.fixture(scope="session")
def finished_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small finished run; tests must not change what is in it."""
    from gsfw.commands.main import main

    out = tmp_path_factory.mktemp("runs") / "finished"
    assert main(["train", "method=3dgs", *SMALL_SCENE, "steps=20", f"out={out}"]) == 0
    return out


@pytest.fixture(params=instruction_sets() or ["none"])
def instruction_set(request: pytest.FixtureRequest) -> Iterator[str]:
    """Each instruction set that this machine runs, in use during the test."""
    module: Any = native()
    if module is None:
        pytest.skip(NOT_BUILT)
    before = module.instruction_set()
    assert module.use_instruction_set(request.param)
    yield request.param
    module.use_instruction_set(before)
