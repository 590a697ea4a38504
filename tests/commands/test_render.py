"""`gsfw render` writes pictures that can be opened."""

import json

import numpy as np
import pytest
from PIL import Image
from support.moving_scene import DriftingPlugin

from gsfw.commands.main import main
from gsfw.plugins.discovery import PluginSource
from gsfw.plugins.registry import installed

MOVING_SCENE = (
    "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "datamanager.moving=true",
    "datamanager.times=3", "steps=5",
)  # fmt: skip


@pytest.fixture(scope="module")
def moving_run(tmp_path_factory):
    """A run of a method whose splats drift, on the built-in scene that moves."""
    discovery = installed()._discovery
    discovery.add(DriftingPlugin(), PluginSource("drifting", "tests", "1.0"))
    out = tmp_path_factory.mktemp("runs") / "moving"
    assert main(["train", "method=drifting", *MOVING_SCENE, f"out={out}"]) == 0
    yield out
    discovery.remove("drifting")


@pytest.fixture(scope="module")
def blurred_run(tmp_path_factory):
    """A run of the static method on the same scene."""
    out = tmp_path_factory.mktemp("runs") / "blurred"
    arguments = ["train", "method=3dgs", "ignore_time=true", *MOVING_SCENE, f"out={out}"]
    assert main(arguments) == 0
    return out


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture).astype(int)


def render(run, out, *arguments) -> int:
    return main(["render", str(run), f"out={out}", "video=webp", *arguments])


def test_held_out_views_are_drawn_beside_their_photos_and_an_orbit(finished_run, tmp_path, capsys):
    out = tmp_path / "pictures"
    assert render(finished_run, out, "frames=4", "scale=0.5", "json=true") == 0
    written = json.loads(capsys.readouterr().out)["written"]
    names = files(out)
    assert names == [
        "orbit.webp", "orbit/0000.png", "orbit/0001.png", "orbit/0002.png",
        "orbit/0003.png", "orbit/frames.json",
        "views/0000_eval_000.png", "views/0001_eval_001.png", "views/frames.json",
    ]  # fmt: skip
    assert len(written) == len(names) - 2
    with Image.open(out / "views" / "0000_eval_000.png") as picture:
        assert picture.size == (64, 24)
        assert len(picture.getcolors(10_000) or []) > 10
    with Image.open(out / "orbit" / "0000.png") as picture:
        assert picture.size == (16, 12)
    with Image.open(out / "orbit.webp") as picture:
        assert picture.n_frames == 4


def test_what_moves_is_drawn_over_time_too(moving_run, tmp_path):
    assert render(moving_run, tmp_path, "frames=3") == 0
    names = files(tmp_path)
    for name in ("orbit", "time", "orbit-time"):
        assert f"{name}.webp" in names
        assert f"{name}/0002.png" in names
    first, last = (pixels(tmp_path / "time" / f"{index:04d}.png") for index in (0, 2))
    assert np.abs(last - first).max() > 30
    # The first frame of the orbit is at the same place and time, whether or not time passes.
    still, moving = (pixels(tmp_path / name / "0000.png") for name in ("orbit", "orbit-time"))
    assert np.array_equal(still, moving)
    still, moving = (pixels(tmp_path / name / "0002.png") for name in ("orbit", "orbit-time"))
    assert not np.array_equal(still, moving)


def test_a_fixed_camera_is_that_of_a_view(moving_run, tmp_path):
    assert render(moving_run, tmp_path, "what=views") == 0
    arguments = ("what=time", "frames=3", "camera=eval_001", "video=none")
    assert render(moving_run, tmp_path, *arguments) == 0
    # The second of two held-out views of the built-in scene is at the second of its three times.
    view = pixels(tmp_path / "views" / "0001_eval_001.png")[:, 32:]
    assert np.array_equal(view, pixels(tmp_path / "time" / "0001.png"))
    assert not (tmp_path / "time.webp").exists()


def test_the_orbit_is_drawn_at_the_time_that_is_given(moving_run, tmp_path):
    for time in (0, 1):
        arguments = ("what=orbit", "frames=1", f"time={time}")
        assert render(moving_run, tmp_path / str(time), *arguments) == 0
    early, late = (pixels(tmp_path / str(time) / "orbit" / "0000.png") for time in (0, 1))
    assert not np.array_equal(early, late)


def test_a_camera_that_is_not_there_names_those_that_are(moving_run, tmp_path, capsys):
    assert render(moving_run, tmp_path, "what=time", "camera=eval_01") == 2
    assert capsys.readouterr().err == (
        "error: camera=eval_01: no view has this name. Did you mean 'eval_001'?\n"
        "The 8 views are eval_000 to train_005. A file of a camera path ends in .json.\n"
    )
    assert files(tmp_path) == []


def test_time_cannot_pass_in_a_static_capture(finished_run, tmp_path, capsys):
    assert render(finished_run, tmp_path, "what=time") == 2
    assert capsys.readouterr().err == (
        "error: what=time: the data (synthetic) has no times, so all frames would show the same "
        "moment.\nRender what=orbit or what=views.\n"
    )


def test_time_cannot_pass_for_a_static_method(blurred_run, tmp_path, capsys):
    assert render(blurred_run, tmp_path, "what=orbit-time") == 2
    assert "what=orbit-time: method 3dgs is static, so all" in capsys.readouterr().err
    assert render(blurred_run, tmp_path, "frames=1") == 0
    assert not (tmp_path / "time").exists()


@pytest.mark.parametrize("setting", ["frames=0", "scale=0", "time=1.5", "fps=0", "fps=2000"])
def test_impossible_numbers_are_one_message(finished_run, capsys, setting):
    assert main(["render", str(finished_run), setting]) == 2
    assert (
        "expected at least 1 frame, a scale above 0, a time in [0, 1], and 1 to 1000 frames per "
        "second."
    ) in capsys.readouterr().err


def test_an_unknown_kind_of_film_names_those_there_are(finished_run, capsys):
    assert main(["render", str(finished_run), "video=gif"]) == 2
    assert "expected one of auto, mp4, webm, webp, none, found 'gif'" in capsys.readouterr().err


def test_a_run_of_what_moves_has_figures_over_time(moving_run, tmp_path, capsys):
    summary = json.loads((moving_run / "metrics.json").read_text())
    assert summary["moving_psnr"] < summary["psnr"]
    assert summary["moving_region"].startswith("masks of the data set (")
    assert summary["flicker"] == "not available: no held-out camera shows several times"
    assert [point["time"] for point in summary["over_time"]] == [0.0, 0.5]
    assert summary["protocol"]["moving_region"].startswith("the data set's masks where it has")
    assert main(["eval", str(moving_run)]) == 0
    said = capsys.readouterr().out
    assert "moving_psnr" in said
    assert "moving_region: masks of the data set (" in said
    plot = moving_run / "eval" / "step_000000005_over_time.png"
    assert f"curve over time: {plot}" in said
    with Image.open(plot) as picture:
        assert picture.width >= 960


def test_an_earlier_checkpoint_is_not_called_the_last(moving_run, capsys):
    checkpoint = moving_run / "checkpoints" / "step_000000000.pt"
    assert main(["eval", str(checkpoint), "json=true"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["protocol"]["checkpoint"] == "after step 0 of 5"
