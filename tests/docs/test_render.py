"""docs/guides/render.md: its commands run, and it has every option, channel and format."""

import json
import re
import shlex
from dataclasses import fields
from pathlib import Path
from typing import get_args, get_type_hints

import pytest
from support.sampling import sampled

from gsfw.commands.main import main
from gsfw.commands.render import RenderOptions
from gsfw.rendering.channels import CHANNELS
from gsfw.rendering.path_files import read_path_file

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "guides" / "render.md").read_text()

COMMANDS = re.findall(r"^gsfw render .*?(?=\s+#|$)", PAGE, re.MULTILINE)

QUICK = ("channel=photo", "camera=path.json", "images=exr")
"""Words of commands that run in plain ``pytest``: views, a path and an orbit."""

KEY_FRAMES = re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the page's camera path."""
    monkeypatch.chdir(tmp_path)
    assert KEY_FRAMES is not None
    document = {**json.loads(KEY_FRAMES[1]), "width": 32, "height": 24}
    (tmp_path / "path.json").write_text(json.dumps(document))
    return tmp_path


@pytest.mark.parametrize(
    "command",
    sampled(
        [(command,) for command in COMMANDS],
        [place for place, line in enumerate(COMMANDS) if any(word in line for word in QUICK)],
    ),
)
def test_a_command_of_the_page_runs(command, folder, trained, finished_run):
    moves = re.search(r"time|motion|tracks", command)
    run = finished_run
    if moves:
        run = trained(
            "method=spacetime", "datamanager.moving=true", "datamanager.times=3",
            "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
            "datamanager.height=24", "datamanager.points=150", "steps=2",
        )  # fmt: skip
    words = shlex.split(command.replace("RUN", str(run)))[1:]
    smaller = ["out=out", *(["width=32"] if "width" in command else [])]
    if "what=views" not in command:
        smaller.append("frames=2")
    assert main([*words, *smaller]) == 0
    assert [file for file in (folder / "out").rglob("*") if file.is_file()]


def test_the_page_has_commands():
    assert len(COMMANDS) > 10


def test_the_page_has_every_option_channel_and_colour_map():
    missing = [item.name for item in fields(RenderOptions) if f"`{item.name}=" not in PAGE]
    assert missing == ["run"], "RUN is a word"
    color_maps = get_args(get_type_hints(RenderOptions)["colormap"])
    names = {*CHANNELS, *color_maps} - {"auto"}
    assert not [name for name in names if f"`{name}`" not in PAGE]


def test_the_key_frames_of_the_page_can_be_read(folder):
    found = read_path_file(folder / "path.json")
    assert len(found.fovs) == 180
    assert found.times is not None
    assert float(found.times[-1]) == 1.0
