"""Where the runs of a user are."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gsfw.commands.interface.run_history import (
    FILE,
    MOST_BYTES,
    history_file,
    remember_run,
    remembered_runs,
)


@pytest.fixture
def home(tmp_path, monkeypatch):
    """The folder that the file lies in; tests never use that of whoever runs them."""
    folder = tmp_path / "state"
    monkeypatch.setenv("GSFW_STATE_DIR", str(folder))
    return folder


def test_a_run_is_remembered_with_its_last_start(home, tmp_path, monkeypatch):
    monkeypatch.setattr("time.time", lambda: 100.0)
    remember_run(tmp_path / "a")
    monkeypatch.setattr("time.time", lambda: 200.0)
    remember_run(tmp_path / "b")
    monkeypatch.setattr("time.time", lambda: 300.0)
    remember_run(tmp_path / "a")
    assert remembered_runs() == {tmp_path / "a": 300.0, tmp_path / "b": 200.0}


def test_relative_folders_are_found_from_elsewhere(home, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    remember_run(Path("a"))
    assert list(remembered_runs()) == [tmp_path / "a"]


def test_lines_that_cannot_be_read_cost_only_themselves(home, tmp_path):
    remember_run(tmp_path / "a")
    with (home / FILE).open("ab") as file:
        file.write(b'{"run": "/half\n\xff\xfe\n[1]\n{"run": 3}\n{"run": "x", "start": "y"}\n')
    remember_run(tmp_path / "b")
    assert list(remembered_runs()) == [tmp_path / "a", tmp_path / "b"]


def test_of_a_long_file_the_end_is_read(home, tmp_path):
    remember_run(tmp_path / "first")
    with (home / FILE).open("a") as file:
        file.write((json.dumps({"run": "/gone", "start": 1.0}) + "\n") * (MOST_BYTES // 30))
    remember_run(tmp_path / "last")
    assert list(remembered_runs()) == [Path("/gone"), tmp_path / "last"]


def test_a_read_only_home_costs_nothing(read_only_folder, tmp_path, monkeypatch):
    monkeypatch.setenv("GSFW_STATE_DIR", str(read_only_folder / "state"))
    remember_run(tmp_path / "a")
    assert remembered_runs() == {}


def test_it_can_be_switched_off(monkeypatch, tmp_path):
    monkeypatch.setenv("GSFW_STATE_DIR", "none")
    remember_run(tmp_path / "a")
    assert history_file() is None
    assert remembered_runs() == {}


@pytest.mark.parametrize(
    ("system", "variables", "expected"),
    [
        ("linux", {}, "/home/someone/.local/state/gsfw"),
        ("linux", {"XDG_STATE_HOME": "/state"}, "/state/gsfw"),
        ("linux", {"XDG_STATE_HOME": "relative"}, "/home/someone/.local/state/gsfw"),
        ("darwin", {}, "/home/someone/Library/Application Support/gsfw"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/gsfw"),
        ("linux", {"GSFW_STATE_DIR": "~/mine"}, "/home/someone/mine"),
    ],
)
def test_the_folder_is_the_one_of_the_system(monkeypatch, system, variables, expected):
    for name in ("GSFW_STATE_DIR", "XDG_STATE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", "/home/someone")
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", system)
    assert history_file() == Path(expected, FILE)


WRITER = """
import sys
from pathlib import Path
from gsfw.commands.interface.run_history import remember_run
sys.stdin.readline()
for number in range(200):
    remember_run(Path(sys.argv[1], str(number)))
"""


def test_processes_that_write_at_once_lose_no_line(home, tmp_path):
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, tmp_path / str(i)], stdin=subprocess.PIPE)
        for i in range(3)
    ]
    for writer in writers:
        assert writer.stdin is not None
        writer.stdin.write(b"go\n")
        writer.stdin.flush()
    for writer in writers:
        writer.communicate()
    assert len(remembered_runs()) == 600
