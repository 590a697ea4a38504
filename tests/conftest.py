"""Fixtures that several folders of tests share."""

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

import hypothesis
import pytest
import torch
from shape_checks import CHECKED_CALLS, Checks
from support.chromium import Chromium, chromium
from support.known_images import KnownImages
from support.made_once import MadeOnce
from support.native_proofs import (  # noqa: F401 - hooks
    pytest_runtest_makereport,
    pytest_runtest_setup,
)
from support.small_scene import SHARED_DATA, SMALL_SCENE
from torch import Tensor

from gsfw.charts import style
from gsfw.commands.interface import progress
from gsfw.jobs import executor
from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets, native
from gsfw.planning import plan
from gsfw.studies import expectation, runner
from gsfw.studies.requirements import report
from gsfw.studies.requirements.plot import plot

# The scenes of tests are small: a second thread gains nothing, and where cores are busy it costs
# several times the work in waiting. Tests of repeatability with threads start their own processes.
torch.set_num_threads(1)

# An example takes as long as it takes: machines of tests are busy.
hypothesis.settings.register_profile("without deadlines", deadline=None)
hypothesis.settings.load_profile("without deadlines")

# What a shell starts in the background ignores SIGINT, and so would all that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests compare standard error, on machines that are slow enough to make any stage a slow one.
progress.PATIENCE = 1e6

# Dry runs and plans measure steps: a few of them are enough where nobody reads the figures.
expectation.TRIAL_SECONDS = plan.FIRST_LOOK = plan.LONGEST_TRIAL = 0.0

# Jobs of tests end in milliseconds.
executor.POLL_SECONDS = runner.POLL_SECONDS = 0.01

# Without bytecode every worker and every process of a test would parse all sources again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def _without_the_disk(handle: int) -> None:
    """Check what ``os.fsync`` is given."""
    os.fstat(handle)


# Campaigns simulate power losses: waiting for the disk proves nothing in this process, and took a
# fifth of the time of tests of commands. Programs that tests start wait for it.
os.fsync = _without_the_disk

# Plugins of whoever runs the tests are none of their business.
os.environ.pop("GSFW_PLUGIN_PATH", None)

# Nothing that tests do is remembered in the home of whoever runs them.
os.environ["GSFW_STATE_DIR"] = "none"

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent

DISTURBED = (
    *("callbacks/test_tensorboard_page.py", "commands/test_races.py", "commands/test_view.py"),
    *("core/loop/test_memory.py", "core/test_training_memory.py", "formats/test_in_spark.py"),
    *("formats/web/test_headset.py", "formats/web/test_player.py", "jobs", "parallel"),
    "preparation/check/test_memory.py",
    *("preparation/test_cancellation.py", "rasterizers/cpu/test_processes.py"),
    *("reports/test_in_browser.py", "studies/tradeoff/test_runner.py", "test_end_to_end.py"),
    "viewer",
)
"""Tests of pages, of processes that wait for each other and of this process's memory.

Other work on the machine can disturb them. They are repeated once if they fail, and the summary
lists those that were repeated. No test of numerics is repeated.
"""

WHOLE_RUNS = {"commands", "plugins"}
"""Folders whose tests are of runs as a whole, not of the parts that these are made of."""

CHARTS = {"charts", "reports"}
"""Folders whose tests look at charts."""

FINE, COARSE = style.DPI, 30
"""Dots per inch of charts: of every test, and of short whole runs that only have to draw some."""


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Leave out slow tests, unless they are asked for: by ``-m`` or by the name of a test."""
    arguments = [str(argument) for argument in config.invocation_params.args]
    asked = any("::" in item or item.startswith("-m") for item in arguments)
    if not config.option.markexpr and not asked:
        config.option.markexpr = "not slow"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Repeat disturbed tests once, where the plugin that repeats them is installed."""
    if not config.pluginmanager.hasplugin("rerunfailures"):
        return
    for path, tests in groupby(items, lambda item: item.path):
        if any(path.is_relative_to(TESTS / place) for place in DISTURBED):
            for item in tests:
                item.add_marker(pytest.mark.flaky(reruns=1))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """Thousands of tests stay until the end: the garbage collector need not look at them."""
    gc.disable()
    result = yield
    gc.freeze()
    gc.enable()
    return result


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, Any, Any]:
    """Check shapes in the first calls of each function, unless whole runs are made.

    These go through what the tests of the parts have checked, and would take longer. Charts are
    half the work of a short run: those of its report are smaller there, and the one of its
    requirements is left out.
    """
    marks = {mark.name for mark in item.iter_markers()}
    folders = set(item.path.relative_to(TESTS).parts[:-1])
    whole = bool(folders & WHOLE_RUNS) or bool(marks & {"slow", "unchecked"})
    Checks.start(0 if whole else CHECKED_CALLS)
    KnownImages.are_used = whole
    looked_at = not whole or bool(folders & CHARTS)
    is_run = bool(folders & WHOLE_RUNS)
    draw_at(FINE if looked_at or ("slow" in marks and not is_run) else COARSE)
    report.plot = plot if looked_at else blank
    return (yield)


def draw_at(dpi: int) -> None:
    """Set the resolution of charts."""
    style.DPI = dpi
    style.SETTINGS |= {"figure.dpi": dpi, "savefig.dpi": dpi}


def blank(requirements: object) -> Tensor:
    """An image in place of the chart of a run's requirements, which tests/studies draw."""
    return torch.zeros(8, 8, 3, dtype=torch.uint8)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, Any, Any]:
    """Nothing may be left in the repository, where the suite is started."""
    before = set(os.listdir(ROOT))
    result = yield
    left = {name for name in os.listdir(ROOT) if name not in before and name[0] != "."}
    # Caches of tools have names with a dot; whatever a test of another worker has left is its own.
    assert not left, f"left in {ROOT} during this test (or one that ran beside it): {sorted(left)}"
    return result


@pytest.fixture
def fine_charts() -> None:
    """Charts as they are, in a test of a whole run."""
    draw_at(FINE)
    report.plot = plot


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    """A browser for all tests of a file."""
    with chromium(tmp_path_factory.mktemp("browser") / "profile") as running:
        yield running


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


@pytest.fixture
def read_only_folder(tmp_path: Path) -> Iterator[Path]:
    """A folder that nobody may write to; root may in all but those of the system's own."""
    folder = tmp_path / "read_only"
    folder.mkdir(mode=0o500)
    if os.access(folder, os.W_OK):
        folder = Path("/proc")
        if not folder.is_dir():
            pytest.skip("root may write anywhere on this system")
        yield folder
        return
    yield folder
    folder.chmod(0o700)


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> MadeOnce:
    """Folders that several tests read, made once for all workers."""
    return MadeOnce(tmp_path_factory)


@pytest.fixture(scope="session")
def trained(made_once: MadeOnce) -> Callable[..., Path]:
    """Gives the folder of a run that ``gsfw train`` has made with some arguments.

    Tests must not change what is in it; those that do work on a copy.
    """
    from gsfw.commands.main import main

    def train(*arguments: str) -> Path:
        def make(out: Path) -> None:
            assert main(["train", *arguments, f"out={out}"]) == 0

        return made_once(make, "run", *arguments)

    return train


@pytest.fixture(scope="session")
def finished_run(trained: Callable[..., Path]) -> Path:
    """The folder of a small finished run; tests must not change what is in it."""
    return trained("method=3dgs", *SMALL_SCENE, "steps=20")


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
