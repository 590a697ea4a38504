"""Signals after COLMAP was loaded, in processes of their own: it is loaded only once."""

import signal
from pathlib import Path

import pytest
from support.forks import ended_forks

from gsfw.core.errors import ConfigError, DataError
from gsfw.kernels.cpu.native_module import native
from gsfw.preparation.native import ABORTED, native_failure, readable_native_errors

LOADED = """
import os, signal, sys
from gsfw.preparation import native

class Signal:
    def find_spec(self, name, path=None, target=None):
        if name == "pycolmap._core":
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Signal())
try:
    native.load_colmap()
except KeyboardInterrupt:
    print("pycolmap" in sys.modules, "interrupted")
print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""
ENDED = """
import os, signal, sys
from gsfw.preparation.native import load_colmap

signal.signal(signal.SIGTERM, lambda *_: sys.exit("cleaned up"))
load_colmap()
os.kill(os.getpid(), signal.SIGTERM)
"""
ABORTS = """
import os
from pathlib import Path
from gsfw.preparation.native import aborts_told, readable_native_errors

moment = {moment!r}
with aborts_told(Path("outer")):
    with readable_native_errors("match features", Path("database.db")):
        if moment == "inside":
            os.abort()
    if moment == "between":
        os.abort()
if moment == "after":
    os.abort()
"""
HELD = """
import os
from pathlib import Path
from gsfw.core.errors import DataError
from gsfw.preparation.native import aborts_told

class Database:
    def __del__(self):
        os.abort()

def work():
    database = Database()
    raise DataError("it failed.", "Try again.")

with aborts_told(Path("outer")):
    work()
"""
PROGRAMS = {
    **{"loaded": LOADED, "ended": ENDED, "held": HELD},
    **{moment: ABORTS.format(moment=moment) for moment in ("inside", "between", "after")},
}


@pytest.fixture(scope="module")
def said(tmp_path_factory) -> dict[str, tuple[int, str, str]]:
    """Exit code, standard output and standard error of each program."""
    prelude = "import gsfw.preparation.native"  # It takes a second, and loads no COLMAP.
    done = ended_forks(prelude, PROGRAMS, tmp_path_factory.mktemp("said"))
    return {name: (one.returncode, one.stdout, one.stderr) for name, one in done.items()}


@pytest.mark.slow
def test_ctrl_c_waits_until_colmap_is_loaded(said):
    assert said["loaded"][1] == "True interrupted\nTrue\n"


@pytest.mark.slow
def test_sigterm_still_lets_python_clean_up(said):
    assert said["ended"] == (1, "", "cleaned up\n")


ADVICE = (
    "Run the same command with a new out=DIR, so that features and matches are computed anew; if "
    "it fails again, report it with what is in DIR/work/log."
)


def test_what_colmap_throws_becomes_a_message_with_advice() -> None:
    with (
        pytest.raises(DataError) as failure,
        readable_native_errors("do it", Path("work/database.db")),
    ):
        raise ValueError("[sfm.cc:77] Check failed: it is so.")
    assert failure.value.message == (
        "COLMAP could not do it with work/database.db: Check failed: it is so."
    )
    assert failure.value.advice == ADVICE


def test_of_a_log_the_last_line_is_shown() -> None:
    error = native_failure(
        "do it", Path("d.db"), "I2026 [sfm.cc:1] begun\n\nValueError: broken\n\n"
    )
    assert error.message == "COLMAP could not do it with d.db: ValueError: broken."


def test_a_process_that_ends_without_a_word_is_said_to() -> None:
    error = native_failure("do it", Path("d.db"), "")
    assert error.message == "COLMAP could not do it with d.db: it stopped without a message."


def test_errors_of_users_pass_unchanged() -> None:
    with pytest.raises(ConfigError, match=r"^theirs$"), readable_native_errors("do it", Path("d")):
        raise ConfigError("theirs")


def test_other_errors_pass_unchanged() -> None:
    with pytest.raises(OSError, match="full"), readable_native_errors("do it", Path("d")):
        raise OSError("the disk is full")


NATIVE = pytest.mark.skipif(native() is None, reason="no native module")


@NATIVE
@pytest.mark.parametrize(
    ("moment", "cause"),
    [
        ("inside", "COLMAP could not match features with database.db"),
        ("between", "COLMAP stopped its work in outer"),
    ],
)
def test_a_library_that_aborts_the_program_ends_it_with_a_message(said, moment, cause):
    assert said[moment] == (2, "", f"error: {cause}.\n{ABORTED}\n")


@NATIVE
def test_outside_of_such_work_programs_abort_as_they_do(said):
    code, _, complained = said["after"]
    assert code == -signal.SIGABRT
    assert "COLMAP" not in complained


@NATIVE
def test_what_an_error_holds_may_abort_the_program_too(said):
    assert said["held"] == (2, "", f"error: COLMAP stopped its work in outer.\n{ABORTED}\n")
