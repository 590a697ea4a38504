"""Blocks of the documentation below a line ``<!-- run -->`` run, page by page, in their order."""

import shutil
from pathlib import Path

import pytest
from support import captured
from support.checked_captures import write_ball, write_moving
from support.pages import PAGES, ROOT, Command, blocks, commands
from support.small_scene import SMALL_SCENE

from gsfw.commands.main import main

# Whole runs of small scenes.
pytestmark = [pytest.mark.slow, pytest.mark.unchecked]

RUNNING = [page for page in PAGES if any(block.runs for block in blocks(page))]

SHORTER = {
    **dict.fromkeys(("minutes", "steps", "until"), "steps=20"),
    **{"frames": "frames=2", "width": "width=32", "views": "views=2"},
}
"""Settings that take the place of those of a page."""

ADDED = {
    "bench": ("repeats=1", "size=64x48", "workload=random:1000"),
    "prepare": ("jobs=1",),
    "runs": ("yes=true",),
    "render": ("frames=2", "width=32"),
    "tradeoff": ("axes=sh", "views=2", "repeats=1"),
    "train": ("steps=20",),
}
"""Settings that a command gets besides, unless it has them."""

DATA = ("DIR", "DATA", "scene", "path/to/capture")
"""Names of static data sets on the pages."""

STATIC, MOVING = ("RUN", "runs/first", "runs/second", "runs/x"), ("runs/moving",)
"""Names of runs on the pages."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Small runs under the names of the pages, photos, and a capture DIR."""
    folder = tmp_path_factory.mktemp("pages")
    for name in DATA:
        write_ball(folder / name)
    moving = write_moving(folder / "path/to/the/capture", (0.0, 0.5, 1.0), cameras=4)
    captured.write(folder / "photos", captured.photos(captured.arc(8)), ".jpg")
    small = ("steps=10", "eval_every=0", "report=false", "device=cpu")
    for name in STATIC:
        assert main(["train", "method=3dgs", *SMALL_SCENE, *small, f"out={folder / name}"]) == 0
    shutil.copy(folder / STATIC[0] / "splats.ply", folder)
    for name in MOVING:
        words = ["method=spacetime", f"data={moving}", *small, f"out={folder / name}"]
        assert main(["train", *words]) == 0
    return folder


def runs_here(command: Command) -> bool:
    """False for verbs that wait in front of a browser."""
    return command.words[1] not in ("view", "open")


def shorter(command: Command) -> list[str]:
    """The words behind ``gsfw``, for a run of seconds."""
    verb, *words = command.words[1:]
    words = [SHORTER.get(word.partition("=")[0], word) if "=" in word else word for word in words]
    keys = {word.partition("=")[0] for word in words}
    if verb == "train" and not keys & {"data", "config", "help"}:
        words += SMALL_SCENE
    if "what=views" in words:  # They have the size of the photos.
        keys |= {"frames", "width"}
    added = [word for word in ADDED.get(verb, ()) if word.partition("=")[0] not in keys]
    if verb == "prepare" and "train=true" in words:
        return [verb, *added, *words]
    return [verb, *words, *added]


@pytest.mark.parametrize("page", RUNNING, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_blocks_of_a_page_run(page, runs, tmp_path, monkeypatch):
    folder = tmp_path / "page"
    shutil.copytree(runs, folder)
    if any("out=scene" in block.text for block in blocks(page) if block.runs):
        shutil.rmtree(folder / "scene")
    monkeypatch.chdir(folder)
    names = {}
    for block in blocks(page):
        if block.runs and block.language == "python":
            exec(compile(block.text, block.place, "exec"), names)
        for command in commands(block.text, block.place) if block.runs else ():
            if block.language == "sh" and command.words[0] == "gsfw" and runs_here(command):
                assert main(shorter(command)) == 0, str(command)


def test_pages_have_blocks_that_run():
    assert {Path("README.md"), Path("docs/guides/report.md")} <= {
        page.relative_to(ROOT) for page in RUNNING
    }
