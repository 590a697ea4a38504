"""Tests of gsfw.commands.interface.run_argument."""

import os

import pytest

from gsfw.commands.interface.run_history import remember_run
from gsfw.commands.interface.runs import RunArgument, newest_runs
from gsfw.commands.interface.runs import find_run as find_run_and_say
from gsfw.core.errors import DataError


def make_run(path, age: int = 0):
    (path / "checkpoints").mkdir(parents=True)
    (path / "config.yaml").touch()
    for item in (path / "config.yaml", path):
        os.utime(item, (1e9 - age, 1e9 - age))
    return path


def find_run(text: str) -> RunArgument:
    """The run, about which nothing is said."""
    said: list[str] = []
    found = find_run_and_say(text, said.append)
    assert said == []
    return found


def refusal(text: str) -> str:
    with pytest.raises(DataError) as caught:
        find_run(text)
    return str(caught.value)


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_folder_is_a_run(tmp_path):
    make_run(tmp_path / "first")
    found = find_run("first")
    assert (str(found.folder.path), found.checkpoint) == ("first", None)


def test_latest_is_the_newest_under_runs(tmp_path):
    for name, age in (("a/3dgs/1", 30), ("b/3dgs/2", 10), ("a/3dgs/3", 20)):
        make_run(tmp_path / "runs" / name, age)
    assert str(find_run("latest").folder.path) == "runs/b/3dgs/2"
    assert [path.name for path in newest_runs()] == ["2", "3", "1"]


def test_a_checkpoint_names_its_run(tmp_path):
    checkpoint = make_run(tmp_path / "first") / "checkpoints" / "step_000000020.pt"
    checkpoint.touch()
    found = find_run(str(checkpoint))
    assert (found.folder.path, found.checkpoint) == (tmp_path / "first", checkpoint)


def test_without_any_run_there_is_no_latest(tmp_path):
    assert refusal("latest") == (
        f"there is no latest run in {tmp_path / 'runs'}, and none elsewhere is known.\n"
        "Give the folder of a run, or train one: gsfw train method=3dgs"
    )


def test_a_missing_run_suggests_the_nearest_and_lists_the_newest(tmp_path):
    make_run(tmp_path / "runs" / "first")
    assert refusal("runs/frist") == (
        "there is no run runs/frist. Did you mean 'first'?\n"
        "RUN is the folder that gsfw train made, a checkpoint in it, a model file (.gsfw), or "
        "latest. Newest runs: runs/first."
    )


def test_a_link_to_a_run_that_is_gone_is_named(tmp_path):
    (tmp_path / "first").symlink_to("gone")
    assert refusal("first").startswith(
        "there is no run first. first is a link to gone, which cannot be reached. Correct the link"
    )


def test_a_folder_that_is_no_run_says_what_it_lacks(tmp_path):
    (tmp_path / "other").mkdir()
    assert refusal("other").startswith("other is not a run: it has no config.yaml.\n")


def test_a_missing_checkpoint_is_a_missing_run(tmp_path):
    make_run(tmp_path / "first")
    assert refusal("first/checkpoints/step_9.pt").startswith(
        "there is no run first/checkpoints/step_9.pt."
    )


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Runs are remembered here."""
    monkeypatch.setenv("GSFW_STATE_DIR", str(tmp_path / "state"))
    monkeypatch.setattr("time.time", lambda: 2e9)


@pytest.mark.usefixtures("home")
def test_latest_is_the_newest_wherever_it_is_and_says_where(tmp_path):
    make_run(tmp_path / "runs" / "a" / "3dgs" / "1")
    elsewhere = make_run(tmp_path / "elsewhere", age=1000)
    assert str(find_run("latest").folder.path) == "runs/a/3dgs/1"
    remember_run(elsewhere)
    said: list[str] = []
    assert find_run_and_say("latest", said.append).folder.path == elsewhere
    assert said == [f"latest is {elsewhere}, which was started or resumed last"]


@pytest.mark.usefixtures("home")
def test_a_newer_start_below_runs_counts_more_than_files_that_were_touched(tmp_path, monkeypatch):
    touched = make_run(tmp_path / "runs" / "a" / "3dgs" / "1", age=-100)
    newer = make_run(tmp_path / "runs" / "a" / "3dgs" / "2", age=1000)
    remember_run(newer)
    monkeypatch.setattr("time.time", lambda: 1.9e9)
    remember_run(touched)
    assert str(find_run("latest").folder.path) == "runs/a/3dgs/2"


@pytest.mark.usefixtures("home")
def test_runs_that_are_gone_are_not_the_latest(tmp_path):
    remember_run(tmp_path / "gone")
    (tmp_path / "emptied").mkdir()
    remember_run(tmp_path / "emptied")
    assert "there is no latest run" in refusal("latest")


def test_where_a_file_of_splats_will_do_a_missing_one_says_so():
    with pytest.raises(DataError) as caught:
        find_run_and_say("nofile.ply", print, splats=True)
    assert str(caught.value) == (
        "there is no run or splat file nofile.ply.\n"
        "RUN is the folder that gsfw train made, a checkpoint in it, a model file (.gsfw), a file "
        "of splats (such as .ply), or latest."
    )
