"""Jobs as processes of this machine: commands, calls, their outcomes and their end."""

import math
import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gsfw.core.callback import Control
from gsfw.datamanagers.images import read_header
from gsfw.jobs import guard
from gsfw.jobs.executor import outcomes
from gsfw.jobs.job import Call, Job, Resources
from gsfw.jobs.local import LocalExecutor
from gsfw.jobs.moved_job import moved
from gsfw.jobs.packed_folder import pack, unpack
from gsfw.jobs.process import JobProcess

SCRIPT = """
import json, os, pathlib, signal, sys, time
verb, *words = sys.argv[1:]
if verb == "threads":
    print(json.dumps({"threads": os.environ["OMP_NUM_THREADS"]}))
if verb == "fail":
    print(json.dumps({"error": "it failed.", "advice": "Do better."}))
    sys.exit(2)
if verb == "wait":
    pathlib.Path(words[0]).touch()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(130))
    time.sleep(60)
"""


@pytest.fixture
def script(tmp_path, monkeypatch) -> Path:
    """Commands are those of a script that imports nothing else."""
    path = tmp_path / "script.py"
    path.write_text(SCRIPT)
    monkeypatch.setattr("gsfw.jobs.process.COMMAND", (sys.executable, "-S", str(path)))
    return path


def done(*jobs: Job, at_once: int = 1):
    with LocalExecutor(at_once) as executor:
        return {job.name: outcome for job, outcome in outcomes(executor, jobs, Control())}


def test_a_command_gives_its_document_or_its_message(script):
    found = done(Job("a", ("threads",), Resources(cpus=3.0)), Job("b", ("fail",)))
    assert found["a"].finished
    assert found["a"].document == {"threads": "3"}
    assert not found["b"].finished
    assert (found["b"].error, found["b"].advice) == ("it failed.", "Do better.")


@pytest.mark.slow
def test_a_call_gives_its_value_or_its_error():
    found = done(
        Job("root", Call(math.sqrt, (4,))),
        Job("none", Call(math.sqrt, (-1,))),
        Job("user", Call(read_header, (Path("absent.jpg"),))),
    )
    assert (found["root"].finished, found["root"].value) == (True, 2.0)
    assert found["none"].error.startswith("ValueError: ")
    assert "absent.jpg" in found["user"].error


def test_a_call_that_is_stopped_cleans_up(tmp_path):
    begun, cleaned = tmp_path / "begun", tmp_path / "cleaned"
    code = (
        "import pathlib, time\n"
        f"pathlib.Path({str(begun)!r}).touch()\n"
        "try: time.sleep(60)\n"
        f"finally: pathlib.Path({str(cleaned)!r}).touch()"
    )
    with LocalExecutor() as executor:
        started = executor.start(Job("a", Call(exec, (code,))))
        while not begun.exists():
            time.sleep(0.02)
        started.stop()
        while (outcome := started.poll()) is None:
            time.sleep(0.02)
    assert outcome.stopped
    assert cleaned.exists()


def test_a_job_without_its_result_has_not_finished(script, tmp_path):
    found = done(Job("a", ("nothing",), result=tmp_path / "absent"))
    assert not found["a"].finished
    assert found["a"].error == "the run ended with exit code 0."


def test_a_requested_stop_ends_jobs_and_starts_no_other(script, tmp_path):
    control, names = Control(), []
    jobs = [Job(str(n), ("wait", str(tmp_path / str(n)))) for n in range(3)]
    with LocalExecutor(2) as executor:
        running = outcomes(executor, jobs, control)
        signal.signal(signal.SIGALRM, lambda *_: control.request_stop("enough"))
        signal.setitimer(signal.ITIMER_REAL, 0.5)
        for job, outcome in running:
            assert outcome.stopped
            names.append(job.name)
    assert sorted(names) == ["0", "1"]
    assert not (tmp_path / "2").exists()


def test_jobs_end_with_their_executor(script, tmp_path):
    with LocalExecutor() as executor:
        started = executor.start(Job("a", ("wait", str(tmp_path / "a"))))
        while not (tmp_path / "a").exists():
            time.sleep(0.02)
        assert started.poll() is None
    assert not started.is_running


def test_a_guard_ends_its_command_with_its_starter(script, tmp_path):
    command = [sys.executable, "-S", guard.__file__, sys.executable, "-S", str(script), "wait"]
    process = subprocess.Popen([*command, str(tmp_path / "a")], stdin=subprocess.PIPE)
    while not (tmp_path / "a").exists():
        time.sleep(0.02)
    process.stdin.close()  # As when the starter has ended.
    assert process.wait(10) == 130


def test_a_guard_hands_on_ctrl_c_also_where_its_starter_blocks_it(tmp_path):
    code = f"import pathlib, time; pathlib.Path({str(tmp_path / 'a')!r}).touch(); time.sleep(60)"
    command = [sys.executable, "-S", guard.__file__, sys.executable, "-S", "-c", code]
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    with process:
        while not (tmp_path / "a").exists():
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == -signal.SIGINT


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGUSR1])
def test_a_guard_ends_as_its_command_has(number):
    kill = f"import os; os.kill(os.getpid(), {int(number)})"
    command = [sys.executable, "-S", guard.__file__, sys.executable, "-S", "-c", kill]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        assert process.wait(10) == -number


def test_a_job_is_moved_with_all_that_names_its_folder():
    folder = Path("runs/a")
    words = ("train", "data=runs/abc", "out=runs/a", "note=runs/a/b")
    job = Job("a", words, folder=folder, resume=("resume", "runs/a"), result=folder / "m.json")
    there = moved(job, Path("/tmp/x"))
    assert there.work == ("train", "data=runs/abc", "out=/tmp/x", "note=/tmp/x/b")
    assert there.resume == ("resume", "/tmp/x")
    assert there.result == Path("/tmp/x/m.json")
    call = Job("b", Call(os.listdir, (folder / "in", 3)), folder=folder)
    assert moved(call, Path("/tmp/x")).work == Call(os.listdir, (Path("/tmp/x/in"), 3))


def test_a_folder_arrives_as_it_left(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.jobs.packed_folder.PIECE", 1000)
    (tmp_path / "a" / "deep").mkdir(parents=True)
    (tmp_path / "a" / "deep" / "file").write_bytes(bytes(range(256)) * 20)
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "old").touch()
    pieces = list(pack(tmp_path / "a"))
    assert len(pieces) > 5
    unpack(pieces, tmp_path / "b")
    assert [path.name for path in (tmp_path / "b").iterdir()] == ["deep"]
    assert (tmp_path / "b/deep/file").read_bytes() == bytes(range(256)) * 20
    assert {path.name for path in tmp_path.iterdir()} == {"a", "b"}


@pytest.mark.skipif(os.name == "nt", reason="modes are those of POSIX")
def test_the_pickle_of_a_call_is_where_nobody_else_can_write():
    process = JobProcess(Job("call", Call(os.getcwd)))
    try:
        assert process._call is not None
        assert stat.S_IMODE(process._call.stat().st_mode) == 0o700
        assert process._call.stat().st_uid == os.getuid()
    finally:
        process.stop()
        process.wait()
