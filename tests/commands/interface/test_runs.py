"""Tests of gsfw.commands.interface.run_argument."""

import os

import pytest

from gsfw.commands.interface.runs import find_run, list_runs
from gsfw.core.errors import DataError


def make_run(path, age: int = 0):
    (path / "checkpoints").mkdir(parents=True)
    (path / "config.yaml").touch()
    for item in (path / "config.yaml", path):
        os.utime(item, (1e9 - age, 1e9 - age))
    return path


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
    assert [path.name for path in list_runs()] == ["2", "3", "1"]


def test_a_checkpoint_names_its_run(tmp_path):
    checkpoint = make_run(tmp_path / "first") / "checkpoints" / "step_000000020.pt"
    checkpoint.touch()
    found = find_run(str(checkpoint))
    assert (found.folder.path, found.checkpoint) == (tmp_path / "first", checkpoint)


def test_without_any_run_there_is_no_latest(tmp_path):
    assert refusal("latest") == (
        f"there is no latest run: {tmp_path / 'runs'} holds none.\n"
        "Give the folder of a run, or train one: gsfw train method=3dgs"
    )


def test_a_missing_run_suggests_the_nearest_and_lists_the_newest(tmp_path):
    make_run(tmp_path / "runs" / "first")
    assert refusal("runs/frist") == (
        "there is no run runs/frist. Did you mean 'first'?\n"
        "RUN is the folder that gsfw train made, a checkpoint in it, a model file (.gsfw), or "
        "latest. Newest runs: runs/first."
    )


def test_a_folder_that_is_no_run_says_what_it_lacks(tmp_path):
    (tmp_path / "other").mkdir()
    assert refusal("other").startswith("other is not a run: it has no config.yaml.\n")


def test_a_missing_checkpoint_is_a_missing_run(tmp_path):
    make_run(tmp_path / "first")
    assert refusal("first/checkpoints/step_9.pt").startswith(
        "there is no run first/checkpoints/step_9.pt."
    )
