"""Keeping a folder to one program."""

import errno
import os
import socket
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from gsfw.core.errors import OutputError
from gsfw.core.files import folder_lock
from gsfw.core.files.folder_lock import CLAIM, LOCK, Owner, only_one


def test_a_second_study_is_kept_out_even_by_a_run_that_was_left_behind(tmp_path):
    with (
        only_one(tmp_path, "another study") as lock,
        pytest.raises(OutputError, match="another study is at work there"),
        only_one(tmp_path, "another study"),
    ):
        pass
    with only_one(tmp_path, "another study") as lock:
        assert lock is not None
        inherited = os.dup(lock)  # As by a process.
    with pytest.raises(OutputError), only_one(tmp_path, "another study"):
        pass
    os.close(inherited)
    with only_one(tmp_path, "another study"):
        pass


def test_the_refusal_names_the_process_that_is_at_work(tmp_path):
    with only_one(tmp_path, "another study"):
        owner = Owner.read(tmp_path / LOCK)
        with pytest.raises(OutputError) as caught, only_one(tmp_path, "another study"):
            pass
    assert owner is not None
    assert (owner.pid, owner.host) == (os.getpid(), socket.gethostname())
    assert str(caught.value) == (
        f"{tmp_path}: another study is at work there (process {os.getpid()} on "
        f"{socket.gethostname()}, since {owner.since}).\n"
        "Wait for it, end it, or choose another folder with out=DIR."
    )


def test_what_a_killed_process_has_left_is_no_lock_and_is_not_named(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", KILLED, tmp_path], stdout=subprocess.PIPE)
    assert child.stdout is not None
    assert child.stdout.readline() == b"locked\n"
    with pytest.raises(OutputError, match=f"process {child.pid} on"), only_one(tmp_path, "it"):
        pass
    child.kill()
    child.wait()
    child.stdout.close()
    with only_one(tmp_path, "it"):
        pass


KILLED = """
import sys, time
from pathlib import Path
from gsfw.core.files.folder_lock import CLAIM, LOCK, Owner, only_one
with only_one(Path(sys.argv[1]), "it"):
    print("locked", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def no_locks(monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(folder_lock.fcntl, "flock", refuse)


@pytest.mark.usefixtures("no_locks")
def test_on_a_disk_without_locks_a_file_that_one_can_create_keeps_others_out(tmp_path):
    with only_one(tmp_path, "it"):
        with (
            pytest.raises(OutputError, match=f"process {os.getpid()} on"),
            only_one(tmp_path, "it"),
        ):
            pass
        assert (tmp_path / CLAIM).is_file()
    assert [path.name for path in tmp_path.iterdir()] == [LOCK]


@pytest.mark.usefixtures("no_locks")
def test_there_the_file_of_a_process_that_is_gone_is_replaced_and_others_stay(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    gone = Owner(child.pid, socket.gethostname(), "2026-01-01 00:00:00 UTC")
    (tmp_path / CLAIM).write_bytes(gone.encoded())
    with only_one(tmp_path, "it"):
        owner = Owner.read(tmp_path / CLAIM)
        assert owner is not None
        assert owner.pid == os.getpid()
    elsewhere = replace(gone, host="another.machine")
    (tmp_path / CLAIM).write_bytes(elsewhere.encoded())
    with pytest.raises(OutputError, match=r"on another\.machine, since 2026-01-01"):
        only_one(tmp_path, "it").__enter__()
    assert Owner.read(tmp_path / CLAIM) == elsewhere


RACER = """
import sys, time
from pathlib import Path
from gsfw.core.errors import OutputError
from gsfw.core.files import folder_lock
if sys.argv[1] == "without":
    def refuse(*_): raise OSError(37, "No locks available")
    folder_lock.fcntl.flock = refuse
print("ready", flush=True)
for line in sys.stdin:
    folder, start = line.split()
    while time.time() < float(start): pass
    try:
        with folder_lock.only_one(Path(folder), "another run"):
            print("has it", flush=True)
            sys.stdin.readline()
    except OutputError as error:
        print(error.message, flush=True)
        sys.stdin.readline()
    print("over", flush=True)
"""


@pytest.mark.parametrize("locks", ["with", "without"])
def test_of_processes_that_start_at_one_instant_exactly_one_gets_a_folder(tmp_path, locks):
    command = [sys.executable, "-c", RACER, locks]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    racers = [subprocess.Popen(command, **pipes) for _ in range(3)]

    def told(text: str) -> None:
        for racer in racers:
            racer.stdin.write(f"{text}\n")
            racer.stdin.flush()

    def answers() -> list[str]:
        return sorted(racer.stdout.readline().rstrip() for racer in racers)

    try:
        assert answers() == ["ready"] * 3
        for number in range(60):
            folder = tmp_path / str(number // 2)  # New ones, and those where there was a lock.
            told(f"{folder} {time.time() + 0.005}")
            *refused, won = answers()
            assert won == "has it"
            assert all(text.startswith(f"{folder}: another run is at") for text in refused)
            told("go on")
            assert answers() == ["over"] * 3
    finally:
        for racer in racers:
            racer.communicate()


def test_a_folder_that_cannot_be_is_told(tmp_path):
    (tmp_path / "file").touch()
    with (
        pytest.raises(OutputError, match="file cannot be written: File exists"),
        only_one(tmp_path / "file", "another study"),
    ):
        pass
