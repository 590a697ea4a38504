"""`gsfw export RUN format=html` and `format=web`: pages that show what the run draws."""

import json
import re
import shutil
from base64 import b64decode
from dataclasses import replace

import pytest
from support.chromium import chromium, needs_chromium
from support.web_player import psnr, watching
from support.web_scenes import read_scene

from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.preview import VIEWS, preview
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore


@pytest.fixture
def run(finished_run, tmp_path):
    """A copy that may be changed."""
    return shutil.copytree(finished_run, tmp_path / "run")


def test_a_page_of_a_run_has_its_title_views_and_image(run, tmp_path, capsys):
    out = tmp_path / "scene.html"
    assert main(["export", str(run), f"out={out}", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "html"
    assert document["bytes"] == out.stat().st_size
    text = out.read_text(encoding="utf-8")
    assert "data:image/webp" in text
    parts = re.findall(r'<script class="scene" [^>]*>(.*?)</script>', text)
    header = read_scene(b"".join(map(b64decode, parts))).header
    scene = restore(RunFolder(run), installed()).composition.scene
    assert f"<title>{scene.name}</title>" in text
    assert header["rows"] > 0
    assert 1 <= len(header["views"]) <= VIEWS
    assert header["up"] == scene.up


def test_a_folder_of_a_run_is_counted_as_a_whole(run, tmp_path, capsys):
    out = tmp_path / "site"
    assert main(["export", str(run), "format=web", f"out={out}", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["bytes"] == sum(path.stat().st_size for path in out.iterdir())
    assert (out / "index.html").is_file()
    assert (out / "social.png").is_file()


def test_a_preview_has_views_of_the_data_in_its_own_world(run):
    restored = restore(RunFolder(run), installed())
    parts, scene = restored.composition.parts, restored.composition.scene
    found = preview(restored)
    camera = parts.data.views(Split.TRAIN).cameras[0]
    moved = scene.world_from_scene.camera(camera.world_to_camera)
    assert (found.views.world_to_camera[0] - moved[0]).abs().max() < 1e-6
    assert found.image is not None
    assert tuple(found.image.shape) == (camera.height, camera.width, 3)


@pytest.mark.slow
@needs_chromium
def test_a_page_shows_what_the_run_draws(run, tmp_path):
    out = tmp_path / "scene.html"
    assert main(["export", str(run), "format=html", f"out={out}"]) == 0
    restored = restore(RunFolder(run), installed())
    parts, scene = restored.composition.parts, restored.composition.scene
    settings = restored.composition.plan.settings
    with chromium(tmp_path / "chromium") as browser:
        page = browser.open(size=(320, 240))
        with watching(page, out) as player:
            for camera in parts.data.views(Split.EVAL).cameras:
                drawn = render_model(parts.model, parts.rasterizer, camera, settings).color[0]
                pose = scene.world_from_scene.camera(camera.world_to_camera)
                moved = replace(camera.to(dtype=pose.dtype), world_to_camera=pose)
                assert psnr(player.look(moved), drawn.clamp(0, 1).numpy()) > 40
