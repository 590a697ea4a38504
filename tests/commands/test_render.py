"""`gsfw render` writes pictures that can be opened."""

import json
import math
import re
import signal
import subprocess
import sys
from time import sleep

import numpy as np
import pytest
import torch
from PIL import Image
from support.moving_scene import SMALL_MOVING_SCENE
from support.small_scene import SMALL_SCENE

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.commands.main import main
from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import write_atomically
from gsfw.plugins.registry import installed
from gsfw.rendering import image_files
from gsfw.rendering.key_frames import CameraPath, KeyFrame, write_camera_path
from gsfw.rendering.paths import find_camera


@pytest.fixture(scope="module")
def blurred_run(tmp_path_factory):
    """A run of the static method on the same scene."""
    out = tmp_path_factory.mktemp("runs") / "blurred"
    arguments = ["train", "method=3dgs", "ignore_time=true", *SMALL_MOVING_SCENE, f"out={out}"]
    assert main(arguments) == 0
    return out


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture).astype(int)


def render(run, out, *arguments) -> int:
    video = () if "what=views" in arguments else ("video=webp",)
    return main(["render", str(run), f"out={out}", *video, *arguments])


@pytest.mark.parametrize(
    ("name", "video"), [("o.mp4", "mp4"), ("o.WEBM", "webm"), ("o.gif", "mp4")]
)
def test_the_name_of_a_film_as_the_folder_is_refused_with_what_to_write(
    name, video, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["render", "latest", "what=orbit", f"out={name}"]) == 2
    assert capsys.readouterr().err == (
        f"error: out={name}: a folder gets the frames, and the films beside them.\n"
        f"Name the folder, and the format of the films: out=o video={video}\n"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_webp_in_place_of_an_mp4_says_what_an_mp4_needs(
    finished_run, tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(sys.modules, "av", None)
    orbit = ("render", str(finished_run), "what=orbit", "frames=1", "width=16")
    for given, hint in (((), " (mp4: pip install 'gsfw[video]')"), (("video=webp",), "")):
        assert main([*orbit, *given, f"out={tmp_path / 'r'}"]) == 0
        said = capsys.readouterr().out
        assert f" images in {tmp_path / 'r' / 'orbit'}\n" in said
        assert f"film: {tmp_path / 'r' / 'orbit.webp'}{hint}\n" in said


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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_time_cannot_pass_for_a_static_method(blurred_run, tmp_path, capsys):
    assert render(blurred_run, tmp_path, "what=orbit-time") == 2
    assert "what=orbit-time: method 3dgs is static, so all" in capsys.readouterr().err
    assert render(blurred_run, tmp_path, "frames=1") == 0
    assert not (tmp_path / "time").exists()


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("frames=0", "at least 1 frame."),
        ("fps=0", "1 to 1000 frames per second."),
        ("fps=2000", "1 to 1000 frames per second."),
    ],
)
def test_an_impossible_number_is_named_alone(finished_run, capsys, setting, expected):
    assert main(["render", str(finished_run), setting]) == 2
    assert capsys.readouterr().err == f"error: {setting}: expected {expected}\n"


def test_an_unknown_kind_of_film_names_those_there_are(finished_run, capsys):
    assert main(["render", str(finished_run), "video=gif"]) == 2
    assert "expected one of auto, mp4, webm, webp, none, found 'gif'" in capsys.readouterr().err


def test_channels_are_side_by_side(moving_run, tmp_path):
    arguments = ("what=views", "channel=photo,color,error,depth", "split=all")
    assert render(moving_run, tmp_path, *arguments) == 0
    assert pixels(tmp_path / "views" / "0000_eval_000.png").shape == (24, 128, 3)
    assert len(list((tmp_path / "views-train").glob("*.png"))) == 6
    manifest = json.loads((tmp_path / "views" / "frames.json").read_text())
    assert set(manifest["scales"]) == {"error", "depth"}


def test_bars_and_names_are_drawn_where_there_is_room(moving_run, tmp_path):
    arguments = ("what=time", "channel=color,motion", "frames=2", "scale=5", "range=0,0.5")
    assert render(moving_run, tmp_path, *arguments, "video=none") == 0
    plain = ("bars=false", "labels=false", "colormap=gray")
    assert render(moving_run, tmp_path / "plain", *arguments, *plain, "video=none") == 0
    wide, narrow = (
        pixels(folder / "time" / "0000.png") for folder in (tmp_path, tmp_path / "plain")
    )
    assert narrow.shape == (120, 320, 3)
    assert wide.shape[1] > 340
    assert not np.array_equal(wide[:20, :60], narrow[:20, :60])
    assert np.array_equal(narrow[:, 160:, 0], narrow[:, 160:, 1])


@pytest.mark.parametrize("what", ["path", "spiral", "path-time", "spiral-time"])
def test_paths_lead_through_and_around_the_views(moving_run, tmp_path, what):
    assert render(moving_run, tmp_path, f"what={what}", "frames=4", "video=none") == 0
    first, *others = (pixels(file) for file in sorted((tmp_path / what).glob("*.png")))
    assert len(others) == 3
    assert all(not np.array_equal(first, other) for other in others)


def test_a_path_begins_and_ends_at_views(moving_run, tmp_path):
    assert render(moving_run, tmp_path, "what=path", "frames=3", "video=none") == 0
    assert render(moving_run, tmp_path, "what=time", "frames=1", "video=none") == 0
    first, view = pixels(tmp_path / "path" / "0000.png"), pixels(tmp_path / "time" / "0000.png")
    # Both at time 0 from eval_000, the first of all names; poses go through float64.
    assert np.abs(first - view).max() <= 2


def test_a_file_of_key_frames_is_a_film_of_its_own(moving_run, tmp_path, capsys):
    restored = restore_run(find_run(str(moving_run), print), installed())
    data = restored.composition.parts.data
    camera = find_camera(data, "eval_001")
    pose = data.scene.world_from_scene.camera(camera.world_to_camera[0])
    fov = 2 * math.degrees(math.atan(12 / float(camera.intrinsics[0, 1, 1])))
    keys = [KeyFrame(torch.linalg.inv(pose), fov, time) for time in (0.0, 1.0)]
    file = write_camera_path(tmp_path / "walk.json", CameraPath(tuple(keys), 2.0, 1.5))
    assert render(moving_run, tmp_path, f"camera={file}") == 0
    assert files(tmp_path / "walk") == ["0000.png", "0001.png", "0002.png", "frames.json"]
    assert not (tmp_path / "views").exists()
    with Image.open(tmp_path / "walk.webp") as film:
        film.seek(1)
        film.load()
        assert film.info["duration"] == 500
    # The same place and time as without a file, but for the rounding of poses.
    arguments = ("what=time", "camera=eval_001", "frames=3", "video=none")
    assert render(moving_run, tmp_path, *arguments) == 0
    for name in ("0000.png", "0002.png"):
        same = np.abs(pixels(tmp_path / "walk" / name) - pixels(tmp_path / "time" / name))
        assert same.max() <= 2


def test_a_camera_path_that_is_not_there_is_one_message(moving_run, tmp_path, capsys):
    assert render(moving_run, tmp_path, "camera=none.json") == 2
    assert "camera=none.json: there is no such file." in capsys.readouterr().err


@pytest.mark.parametrize(
    ("images", "suffix", "form"), [("jpg", "jpg", "JPEG"), ("png16", "png", "PNG")]
)
def test_frames_have_the_format_that_is_asked_for(moving_run, tmp_path, images, suffix, form):
    assert render(moving_run, tmp_path, "what=orbit", "frames=2", f"images={images}") == 0
    with Image.open(tmp_path / "orbit" / f"0001.{suffix}") as picture:
        assert (picture.format, picture.size) == (form, (32, 24))
    with Image.open(tmp_path / "orbit.webp") as film:
        assert film.n_frames == 2


def test_an_exr_has_values_and_makes_no_film(moving_run, tmp_path):
    arguments = ("what=orbit", "frames=1", "images=exr", "channel=color,depth,motion")
    assert main(["render", str(moving_run), f"out={tmp_path}", *arguments]) == 0
    assert files(tmp_path) == ["orbit/0000.exr", "orbit/frames.json"]
    header = (tmp_path / "orbit" / "0000.exr").read_bytes()[:400]
    assert all(name + b"\0\x02\0\0\0" in header for name in (b"B", b"G", b"R", b"Z", b"motion"))


def test_stereo_and_panoramas_have_their_sizes(moving_run, tmp_path):
    for projection, size in (("stereo", (64, 24)), ("panorama", (96, 48))):
        arguments = [f"projection={projection}", "what=orbit", "frames=1", "video=none"]
        if projection == "panorama":
            arguments.append("width=96")
        assert render(moving_run, tmp_path / projection, *arguments) == 0
        with Image.open(tmp_path / projection / "orbit" / "0000.png") as picture:
            assert picture.size == size
            assert len(picture.getcolors(10_000) or []) > 10


def test_frames_that_are_there_are_kept(moving_run, tmp_path, capsys):
    arguments = ("what=orbit", "frames=3", "video=none", "channel=depth")
    assert render(moving_run, tmp_path, *arguments) == 0
    frame, gone = tmp_path / "orbit" / "0000.png", tmp_path / "orbit" / "0002.png"
    before, expected = frame.stat().st_mtime_ns, gone.read_bytes()
    gone.unlink()
    capsys.readouterr()
    assert render(moving_run, tmp_path, *arguments) == 0
    assert "orbit: 2 of 3 frames were rendered before" in capsys.readouterr().out
    assert frame.stat().st_mtime_ns == before
    assert gone.read_bytes() == expected
    assert render(moving_run, tmp_path, "what=orbit", "frames=2", "video=none") == 0
    assert frame.stat().st_mtime_ns != before
    assert not gone.exists()


def test_what_stops_in_the_middle_leaves_whole_frames(moving_run, tmp_path, monkeypatch, capsys):
    written = []

    def full_after_two(path, content):
        if len(written) == 3:
            raise OutputError("the disk is full")
        written.append(path)
        write_atomically(path, content)

    monkeypatch.setattr(image_files, "write_atomically", full_after_two)
    arguments = ("what=orbit", "frames=5", "video=none")
    assert render(moving_run, tmp_path, *arguments) == 2
    assert "the disk is full" in capsys.readouterr().err
    monkeypatch.undo()
    assert render(moving_run, tmp_path, *arguments) == 0
    assert "orbit: 3 of 5 frames were rendered before" in capsys.readouterr().out


PROGRAM = """
import signal, sys
from gsfw.commands.main import main
signal.signal(signal.SIGINT, signal.default_int_handler)  # Whoever runs the tests may ignore it.
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_an_interrupted_render_says_that_it_can_go_on(moving_run, tmp_path):
    arguments = [
        "what=orbit",
        "frames=4000",
        "video=none",
        "channel=color,depth",
        f"out={tmp_path}",
    ]
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "render", str(moving_run / "splats.ply"), *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    while process.poll() is None and not (tmp_path / "orbit" / "0003.png").exists():
        sleep(0.02)
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate()
    assert process.returncode == 130
    found = re.search(r"orbit: (\d+) of 4000 frames are there; the same command continues", said)
    assert found is not None, said
    frames = sorted((tmp_path / "orbit").iterdir())
    assert len(frames) == int(found[1]) + 1, "and the list of frames"
    for frame in frames[:-1]:
        assert pixels(frame).shape[2] == 3


def test_a_full_disk_leaves_whole_frames(moving_run, tiny_disk, capsys):
    arguments = ("what=orbit", "frames=9", "video=none", "images=exr", "width=320")
    assert main(["render", str(moving_run), f"out={tiny_disk}", *arguments]) == 2
    assert "the disk is full" in capsys.readouterr().err
    left = sorted((tiny_disk / "orbit").iterdir())
    assert {item.suffix for item in left} == {".exr", ".json"}
    sizes = [item.stat().st_size for item in left if item.suffix == ".exr"]
    assert 1 <= len(sizes) < 9
    assert min(sizes) > 0.5 * max(sizes)


def test_another_background_is_behind_the_scene(finished_run, tmp_path):
    arguments = ("what=orbit", "frames=1", "video=none", "background=0,1,0")
    assert render(finished_run, tmp_path, *arguments) == 0
    green = pixels(tmp_path / "orbit" / "0000.png")[0, 0]
    assert green[1] > 2 * max(green[0], green[2])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("what=orbit channel=error", "error needs a photo, and there is none along a camera path"),
        ("channel=dept", "there is no channel 'dept'. Did you mean 'depth'?"),
        ("what=orbit channel=motion", "channel=motion: this model does not change with time"),
        ("time=0.5", "time=0.5: the data (synthetic) has no times, so every time shows the same"),
        ("camera=eval_000", "only what=time renders from the camera of a view"),
        ("tracks=true", "tracks=true: all frames show one time, so that nothing moves"),
        ("range=3,1 channel=depth", "range=3,1: expected two numbers, the smaller one first"),
        ("width=100 scale=2", "width=100 scale=2: both give the size of the frames"),
        ("images=exr video=mp4", "a film is made of pictures, and an EXR holds values"),
        ("what=views projection=stereo", "views are compared with photos, which have one image"),
        ("what=time camera=a.json", "what=time camera=a.json: the file has the whole path"),
        ("background=green", "background=green: expected white, black, auto, or three numbers"),
        ("eye_distance=-1", "eye_distance=-1: expected a finite number of at least 0"),
        ("tracks=true what=spiral", "nothing moves there"),
        (
            "tracks=true channel=depth",
            "tracks are drawn on the colours.\nAdd color to channel, or",
        ),
    ],
)
def test_what_cannot_be_is_one_sentence_with_a_remedy(finished_run, capsys, arguments, message):
    assert main(["render", str(finished_run), *arguments.split()]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.usefixtures("fine_charts")
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
    assert f", {plot}" in said
    with Image.open(plot) as picture:
        assert picture.width >= 960


def test_an_earlier_checkpoint_is_not_called_the_last(moving_run, capsys):
    checkpoint = moving_run / "checkpoints" / "step_000000000.pt"
    assert main(["eval", str(checkpoint), "json=true"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["protocol"]["checkpoint"] == "after step 0 of 5"


def test_a_run_without_held_out_views_renders_its_films_and_says_that_it_has_no_views(
    trained, tmp_path, capsys
):
    run = trained("method=3dgs", *SMALL_SCENE, "steps=2", "datamanager.eval_views=0")
    film = ("channel=count", "frames=1", "video=none")
    assert main(["render", str(run), f"out={tmp_path}", *film]) == 0
    assert [path.name for path in tmp_path.rglob("*.png")] == ["0000.png"]
    capsys.readouterr()
    assert main(["render", str(run), f"out={tmp_path}", "what=views"]) == 2
    assert capsys.readouterr().err == (
        "error: what=views: this run has no held-out images to render.\n"
        "Render those it was trained on with split=train.\n"
    )
