"""The library of file faults fails, shortens, interrupts and records the calls it should."""

import errno
import os
import signal
import subprocess
import sys

import pytest
from disk_states import read_log
from file_faults import CHANGES, Calls, Fault, Kind, compiler, ends_at, fails_with, library

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs Linux and a C compiler (cc)")

WORK = """
import os, sys, time
from pathlib import Path
place = Path(sys.argv[1])
out = []
try:
    place.mkdir()
    handle = os.open(place / "new", os.O_WRONLY | os.O_CREAT)
    out.append(os.write(handle, b"12345678"))
    os.fsync(handle)
    os.ftruncate(handle, 8)
    os.close(handle)
    os.rename(place / "new", place / "named")
    (place / "named").read_bytes()
    os.unlink(place / "named")
    out.append("done")
except OSError as error:
    out.append(error.errno)
Path(sys.argv[2]).write_text(repr(out))
"""
"""One call of each kind, in order: mkdir, open, write, fsync, truncate, close, rename, unlink."""

ORDER = (
    *(Calls.MKDIR, Calls.OPEN, Calls.WRITE, Calls.FSYNC),
    *(Calls.TRUNCATE, Calls.CLOSE, Calls.RENAME, Calls.UNLINK),
)


def done(tmp_path, fault, script=WORK):
    """The exit code of the script with a fault, and what it has seen."""
    place, seen = tmp_path / "place", tmp_path / "seen"
    environment = {
        **os.environ,
        **fault.environment(place, tmp_path / "count"),
        "LD_PRELOAD": str(library()),
    }
    command = [sys.executable, "-S", "-c", script, str(place), str(seen)]
    process = subprocess.run(
        command, env=environment, capture_output=True, start_new_session=True, check=False
    )
    return process.returncode, eval(seen.read_text()) if seen.exists() else None


def test_without_a_fault_calls_are_counted_alone(tmp_path):
    assert done(tmp_path, Fault()) == (0, [8, "done"])
    count = int.from_bytes((tmp_path / "count").read_bytes()[:8], "little")
    # Path.mkdir and reading a file close nothing that is counted but the file that is read.
    assert count == len(ORDER) + 1


@pytest.mark.parametrize("call", ORDER, ids=lambda call: call.name.lower())
def test_each_kind_of_call_fails(tmp_path, call):
    code, seen = done(tmp_path, fails_with("EIO", 1, (call,)))
    assert code == 0
    assert seen[-1] == errno.EIO


THRICE = """
import os, sys
for name in ("", "1", "2"):
    try:
        os.mkdir(os.path.join(sys.argv[1], name))
    except OSError:
        pass
"""


def test_only_the_call_of_the_number_fails_unless_the_fault_lasts(tmp_path):
    done(tmp_path, fails_with("ENOSPC", 2, (Calls.MKDIR,)), THRICE)
    assert os.listdir(tmp_path / "place") == ["2"]
    (tmp_path / "place" / "2").rmdir()
    (tmp_path / "count").unlink()
    done(tmp_path, fails_with("ENOSPC", 2, (Calls.MKDIR,), lasting=True), THRICE)
    assert os.listdir(tmp_path / "place") == []


def test_a_short_write_writes_half(tmp_path):
    assert done(tmp_path, Fault(Kind.SHORT, Calls.WRITE, at=1)) == (0, [4, "done"])


@pytest.mark.parametrize("after", [False, True])
def test_a_kill_comes_before_or_after_the_call(tmp_path, after):
    code, seen = done(tmp_path, ends_at(1, after, Calls.RENAME))
    assert (code, seen) == (-signal.SIGKILL, None)
    assert os.listdir(tmp_path / "place") == ["named" if after else "new"]


def test_a_folder_vanishes(tmp_path):
    code, seen = done(tmp_path, Fault(Kind.VANISH, Calls.WRITE, at=1))
    assert code == 0
    assert seen == [8, errno.ENOENT]
    assert os.listdir(tmp_path / "place.away") == ["new"]


def test_the_clock_jumps_after_some_readings(tmp_path):
    script = (
        "import sys,time\nfrom pathlib import Path\n"
        "seen=[time.time() for _ in range(4)]\nPath(sys.argv[2]).write_text(repr(seen))"
    )
    fault = Fault(clock=-86_400, clock_at=2)
    _, seen = done(tmp_path, fault, script)
    days = [round((each - seen[0]) / 86_400) for each in seen]
    assert days[-1] == -1 or days == [0, 0, 0, 0], "the interpreter may have read it before"
    assert round((seen[-1] - os.stat(tmp_path / "seen").st_mtime) / 86_400) == -1


def test_operations_are_recorded_in_order_with_their_bytes(tmp_path):
    place, log = tmp_path / "place", tmp_path / "log"
    script = (
        "import ctypes,os,sys\n"
        f"ctypes.CDLL(None).faults_set({os.fsencode(place)!r}, {int(CHANGES)}, 0, 0, "
        f"ctypes.c_long(0), 0, b'', {os.fsencode(log)!r})\n"
    )
    environment = {**os.environ, "LD_PRELOAD": str(library())}
    command = [sys.executable, "-S", "-c", script + WORK, str(place), str(tmp_path / "seen")]
    subprocess.run(command, env=environment, check=True)
    found = read_log(log)
    kinds = ["mkdir", "create", "write", "fsync", "truncate", "rename", "unlink"]
    assert [item.kind for item in found] == kinds
    assert (found[2].data, found[2].place, found[4].place) == (b"12345678", 0, 8)
    assert found[5].other == str(place / "named")
