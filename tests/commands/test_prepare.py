"""`gsfw prepare`: from photos, video and other tools' data sets to one that trains."""

import json
import shutil
from contextlib import contextmanager

import numpy as np
import pycolmap
import pytest
from PIL import Image
from support import captured
from support.here_executor import HereExecutor
from support.matched_captures import pose_errors
from support.panorama_room import FULL_XMP
from support.small_videos import write_video

from gsfw.commands import prepare
from gsfw.commands.interface.console import Console
from gsfw.commands.interface.prepare_options import PrepareOptions, preparation_rule
from gsfw.commands.main import main
from gsfw.core.errors import DataError
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.progress import shown_by
from gsfw.preparation import native
from gsfw.preparation.report import unused_rows

PHOTOS = 9
FRAMES = 32


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Photos on an arc, one of them stored sideways with an EXIF orientation, and a broken one."""
    folder = tmp_path_factory.mktemp("prepare") / "photos"
    pictures = captured.photos(captured.arc(PHOTOS))
    captured.write(folder, pictures, ".jpg")
    exif = Image.Exif()
    exif[0x0112] = 6  # To be turned by 90 degrees clockwise.
    turned = Image.fromarray(np.ascontiguousarray(np.rot90(pictures[3])))
    turned.save(folder / "photo_003.jpg", quality=95, exif=exif)
    (folder / "photo_900.jpg").write_bytes(b"")
    (folder / "notes.txt").write_text("of the trip")
    return folder


@pytest.fixture(scope="module")
def prepared(photos, tmp_path_factory):
    """The folder of a data set that was made of them."""
    out = tmp_path_factory.mktemp("prepare") / "scene"
    assert main(["prepare", str(photos), f"out={out}", "jobs=1"]) == 0
    return out


def document(out):
    return json.loads((out / "prepare.json").read_text())


def model_of(out):
    return pycolmap.Reconstruction(out / "sparse" / "0")


def size_of(path):
    """Width and height, and the EXIF orientation."""
    with Image.open(path) as picture:
        return *picture.size, picture.getexif().get(0x0112, 1)


@pytest.mark.slow
def test_photos_become_a_data_set_with_a_verdict_a_report_and_a_sheet(prepared, photos):
    report = document(prepared)
    assert report["verdict"] == "usable with limits"  # There are few images.
    assert report["given"] == PHOTOS
    assert len(report["registered"]) == PHOTOS
    assert [item["name"] for item in report["left_out"]] == ["photo_900.jpg"]
    assert report["left_out"][0]["reason"] == "the file is empty (0 bytes)"
    assert report["model"]["error"] < 1.0
    assert report["next"].startswith(f"gsfw train method=3dgs data={prepared}")
    assert "second attempt" not in report["chosen"]
    assert set(report["seconds"]) == {"features", "matches", "cameras", "data set"}
    truth = captured.arc(PHOTOS).world_to_camera.numpy()[:, :3]
    names = [f"photo_{number:03d}.jpg" for number in range(PHOTOS)]
    degrees, distance = pose_errors(model_of(prepared), dict(zip(names, truth, strict=True)))
    assert degrees < 0.5
    assert distance < 0.02
    (camera,) = model_of(prepared).cameras.values()
    assert abs(camera.focal_length_x / captured.FOCAL - 1) < 0.03
    assert size_of(prepared / "prepare.png")[0] == 1200
    assert len(list(photos.iterdir())) == PHOTOS + 2, "what it is made from stays as it was"


@pytest.mark.slow
def test_the_same_command_has_nothing_left_to_do(prepared, photos, capsys):
    before = (prepared / "sparse/0/images.bin").read_bytes()
    assert main(["prepare", str(photos), f"out={prepared}", "json=true"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == document(prepared)
    assert "It takes 5 minutes (minutes=N: another time); both at once: gsfw prepare " in said.err
    assert "cameras: " not in said.err
    assert (prepared / "sparse/0/images.bin").read_bytes() == before


@pytest.mark.slow
def test_jobs_of_many_machines_make_the_same_data_set(prepared, photos, tmp_path, monkeypatch):
    executor = HereExecutor(places=3)
    monkeypatch.setattr(prepare, "executor_of", lambda options, jobs: executor)
    words = [str(photos), f"out={tmp_path / 'out'}", "jobs=1", "executor=ray"]
    assert main(["prepare", *words]) == 0
    assert [job.name for job in executor.jobs[:4]] == [
        *3 * ["features of 3 images"],
        "matches of 12 pairs",
    ]
    for name in ("cameras.bin", "images.bin", "points3D.bin"):
        written = (place / "sparse" / "0" / name for place in (prepared, tmp_path / "out"))
        assert len({path.read_bytes() for path in written}) == 1


@pytest.mark.slow
def test_models_and_pictures_that_were_removed_are_made_again(prepared, photos, capsys):
    shutil.rmtree(prepared / "work" / "models" / "0")
    (prepared / "images" / "photo_001.jpg").unlink()
    assert main(["prepare", str(photos), f"out={prepared}", "jobs=1"]) == 0
    said = capsys.readouterr().out
    assert f"cameras: {PHOTOS} of {PHOTOS}" in said
    assert "matches: " not in said
    assert (prepared / "images" / "photo_001.jpg").is_file()


@pytest.mark.slow
def test_another_setting_repeats_only_what_depends_on_it(prepared, photos, capsys):
    assert main(["prepare", str(photos), f"out={prepared}", "lens=keep"]) == 0
    said = capsys.readouterr().out
    assert f"images: {PHOTOS} of {PHOTOS}" in said
    assert "matches: " not in said
    assert document(prepared)["data_set"]["lens"] == "SIMPLE_RADIAL as given"
    assert size_of(prepared / "images" / "photo_003.jpg") == (320, 240, 1)


@pytest.mark.parametrize("layout", ["auto", "colmap", "transforms"])
def test_the_layout_is_that_of_computed_cameras_too(layout):
    options = PrepareOptions(inputs=("walk.mp4",), layout=layout)
    assert preparation_rule(options).layout == (
        "transforms" if layout == "transforms" else "colmap"
    )


@pytest.mark.parametrize(
    ("words", "layout"),
    [
        ("walk.mp4 train=true method=4dgs", "transforms"),
        ("walk.mp4 train=true method=3dgs", "colmap"),
        ("walk.mp4 train=true", "colmap"),
        ("clips train=true method=4dgs", "transforms"),
        ("walk.mp4 layout=colmap train=true method=3dgs", "colmap"),
    ],
)
def test_times_of_videos_are_kept_for_a_method_that_trains_on_them(
    tmp_path, monkeypatch, capsys, words, layout
):
    def document(console, options, inputs, place, rule):
        raise DataError(f"the layout is {rule.layout}")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(prepare, "_document", document)
    (tmp_path / "clips").mkdir()
    for name in ("walk.mp4", "clips/a.mp4"):
        (tmp_path / name).touch()
    assert main(["prepare", "out=scene", *words.split()]) == 2
    said = capsys.readouterr()
    assert f"the layout is {layout}" in said.err
    assert ("layout=transforms: " in said.out) == (layout == "transforms")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("walk.mp4 layout=colmap", "layout=colmap: a COLMAP model has no times, and method 4dgs"),
        ("photos", "method 4dgs trains on images with times, and photos such as photos/"),
        ("walk.mp4 photos", "method 4dgs trains on images with times, and photos such as photos/"),
        ("photos layout=transforms", "method 4dgs trains on images with times, and photos such"),
    ],
)
def test_images_without_times_are_refused_at_once_for_a_method_that_needs_them(
    tmp_path, monkeypatch, capsys, words, message
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(prepare, "_document", lambda *given: pytest.fail("it began to prepare"))
    (tmp_path / "walk.mp4").touch()
    captured.write(tmp_path / "photos", [np.full((48, 64, 3), 128, np.uint8)], ".jpg")
    given = ["prepare", "out=scene", *words.split(), "train=true", "method=4dgs"]
    assert main(given) == 2
    assert f"error: {message}" in capsys.readouterr().err
    assert not (tmp_path / "scene").exists()


@pytest.mark.slow
def test_a_video_becomes_splats_with_two_commands(tmp_path):
    truth = captured.arc(FRAMES, step=2.0)
    pictures = captured.photos(truth)
    video = write_video(
        tmp_path / "walk.mp4", FRAMES, 320, 240, draw=lambda number, *_: pictures[number]
    )
    scene, run = tmp_path / "scene", tmp_path / "run"
    assert main(["prepare", str(video), f"out={scene}", "frames=12", "jobs=1"]) == 0
    true = {f"{i:06d}.jpg": pose for i, pose in enumerate(truth.world_to_camera.numpy()[:, :3])}
    assert document(scene)["given"] >= 10
    assert document(scene)["unregistered"] == []
    degrees, distance = pose_errors(model_of(scene), true)
    assert degrees < 1.0
    assert distance < 0.03
    settings = ("device=cpu", "steps=150", "eval_every=0", f"out={run}")
    assert main(["train", "method=3dgs", f"data={scene}", *settings]) == 0
    assert json.loads(RunFolder(run).summary.read_text())["psnr"] > 16
    assert RunFolder(run).splats.is_file()


@pytest.mark.slow
def test_photos_become_splats_with_one_command(photos, tmp_path, capsys):
    scene = tmp_path / "scene"
    words = ["prepare", str(photos), f"out={scene}", "jobs=1", "train=true", "device=cpu"]
    words += ["steps=60", "eval_every=0", "report=false"]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "verdict: usable with limits" in said
    assert f"training: gsfw train method=3dgs data={scene}" in said
    assert "It takes 5 minutes" not in said
    assert RunFolder(scene / "run").splats.is_file()
    before = RunFolder(scene / "run").splats.stat().st_mtime_ns
    assert main(words) == 0
    said = capsys.readouterr().out
    assert "is finished already" in said
    assert "matches: " not in said
    other = tmp_path / "other"
    assert main([*words, "steps=20", f"out={other}"]) == 0
    assert RunFolder(other).splats.is_file()
    capsys.readouterr()
    assert main([*words[:-3], "report=false", "--eval-every", "0", "steps=60", "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == {"run": str(scene / "run"), "completed": True}
    assert RunFolder(scene / "run").splats.stat().st_mtime_ns == before


def test_what_will_not_train_is_not_trained(tmp_path, capsys):
    captured.write(tmp_path / "a", [np.full((48, 64, 3), 128, np.uint8)] * 3, ".jpg")
    words = [str(tmp_path / "a"), f"out={tmp_path / 'out'}", "jobs=1", "train=true", "minutes=1"]
    assert main(["prepare", *words]) == 1
    assert "training: " not in capsys.readouterr().out
    assert not (tmp_path / "out" / "run").exists()


def test_pictures_that_show_nothing_will_not_train(tmp_path, capsys):
    captured.write(tmp_path / "a", [np.full((48, 64, 3), 128, np.uint8)] * 2, ".jpg")
    Image.fromarray(np.full((48, 64, 3), 90, np.uint8)).save(tmp_path / "a" / "x.jpg")
    assert main(["prepare", str(tmp_path / "a"), f"out={tmp_path / 'out'}", "jobs=1"]) == 1
    said = capsys.readouterr().out
    assert "verdict: will not train" in said
    report = document(tmp_path / "out")
    assert (report["data_set"], report["next"]) == ({}, "")
    assert not (tmp_path / "out" / "sparse").exists()
    assert size_of(tmp_path / "out" / "prepare.png")[0] == 1200


@pytest.mark.slow
def test_everything_again_cuts_panoramas_again(tmp_path):
    (tmp_path / "photos").mkdir()
    Image.new("RGB", (512, 256)).save(tmp_path / "photos" / "a.jpg", xmp=FULL_XMP)
    times = []
    for words in ((), (), ("again=true",)):
        main(["prepare", str(tmp_path / "photos"), f"out={tmp_path / 'out'}", *words])
        views = sorted((tmp_path / "out" / "work" / "views").iterdir())
        times.append([file.stat().st_mtime_ns for file in views])
    assert len(times[0]) == 6
    assert times[0] == times[1]
    assert not set(times[1]) & set(times[2])


def test_a_run_is_not_taken_for_photos(tmp_path, capsys):
    run, out = tmp_path / "trained", tmp_path / "scene"
    captured.write(run / "eval", captured.photos(captured.arc(2)))
    (run / "config.yaml").write_text("schema: 1\nmethod: 3dgs\ndata: the/garden\n")
    assert main(["prepare", str(run), f"out={out}"]) == 2
    said = capsys.readouterr().err
    assert f"{run}: this is a run of gsfw, and no folder of photos." in said
    assert "Give the data set that it was trained on: the/garden" in said
    assert not out.exists()


def test_a_vocabulary_is_looked_at_before_anything_is_computed(tmp_path, capsys):
    captured.write(tmp_path / "a", [np.full((48, 64, 3), 128, np.uint8)], ".jpg")
    (tmp_path / "words.bin").write_text("no vocabulary")
    out, words = tmp_path / "out", tmp_path / "words.bin"
    assert f"vocabulary={words} is" in told(
        capsys, tmp_path / "a", f"out={out}", f"vocabulary={words}"
    )
    assert not (out / "work" / "database.db").exists()


def test_the_loading_of_torch_is_shown(tmp_path):
    names = []

    @contextmanager
    def record(name, total):
        names.append(name)
        yield lambda done: None

    with shown_by(record), pytest.raises(DataError, match="no such file or folder"):
        prepare.run([str(tmp_path / "nowhere")])
    assert names == ["loading torch"]


def test_a_missing_colmap_is_told_with_what_to_do(tmp_path, capsys, monkeypatch):
    def load():
        raise ModuleNotFoundError("No module named 'pycolmap'")

    monkeypatch.setattr(native, "load_colmap", load)
    assert told(capsys, tmp_path, f"out={tmp_path / 'out'}") == (
        "error: pycolmap, which computes cameras, cannot be loaded: No module named 'pycolmap'.\n"
        "Install it anew with: pip install --force-reinstall 'pycolmap>=4.2'\n"
    )


def test_long_names_leave_room_in_the_table(capsys):
    document = {"left_out": [{"name": "y" * 99 + ".jpg", "reason": "it is empty"}]}
    Console().table(["not used", "reason", ""], unused_rows(document))
    assert f"\n...{'y' * 36}.jpg  left out  it is empty\n" in capsys.readouterr().out


def told(capsys, *arguments):
    assert main(["prepare", *map(str, arguments)]) == 2
    return capsys.readouterr().err


def test_mistakes_are_told_in_a_sentence(tmp_path, capsys):
    (tmp_path / "photos").mkdir()
    out = f"out={tmp_path / 'out'}"
    assert "gsfw prepare: INPUT... is missing." in told(capsys, out)
    wrong = told(capsys, tmp_path / "potos", out)
    assert f"{tmp_path / 'potos'}: there is no such file or folder." in wrong
    assert "photos" in wrong
    photos = tmp_path / "photos"
    assert "photos" in told(capsys, photos, out)
    assert not (tmp_path / "out").exists(), "nothing is written before an input is accepted"
    assert "frames=2: expected a number of at least 3." in told(capsys, photos, out, "frames=2")
    assert "features=5: expected 50 to 32768." in told(capsys, photos, out, "features=5")
    assert "gsfw prepare: an INPUT is empty." in told(capsys, "", out)
    assert "jobs=-1: expected a number of at least 0." in told(capsys, photos, out, "jobs=-1")
    assert "camera_model=" in told(capsys, photos, out, "camera_model=PINWHEEL")
    assert "poses=keep: 2 inputs are given." in told(capsys, photos, tmp_path, out, "poses=keep")
    assert "unknown key 'frame'" in told(capsys, photos, out, "frame=3")
    for key in ("job.cpus=2", "job.memory_mb=500", "ray.address=local"):
        refused = told(capsys, photos, out, key)
        assert f"{key.removesuffix('=2').removesuffix('=500')} has no effect with" in refused
        assert "Add executor=ray, or leave it out." in refused
    least = told(capsys, photos, out, "executor=ray", "job.cpus=0")
    assert "job.cpus=0: expected 0.01 or more." in least
    assert "unknown key 'job.gpus'" in told(capsys, photos, out, "executor=ray", "job.gpus=1")
    assert "which the result is made from" in told(capsys, photos, f"out={photos}")
    shutil.rmtree(tmp_path / "out", ignore_errors=True)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").touch()
    assert "is not empty" in told(capsys, photos, out)
