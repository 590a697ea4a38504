"""A model file takes the place of a run wherever no pictures are needed."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from gsfw.api.models import load
from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.maths.frame import transform_splats
from gsfw.core.model import PrimitiveModel
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "guides" / "model-file.md"

MOVING = (
    "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "datamanager.moving=true",
    "datamanager.times=3", "steps=6",
)  # fmt: skip


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    """A data set on disk, of three times: pictures of noise around a centre."""
    folder = tmp_path_factory.mktemp("data") / "capture"
    (folder / "images").mkdir(parents=True)
    generator = np.random.default_rng(0)
    frames = []
    for index in range(6):
        angle = 2 * np.pi * index / 6
        cos, sin = np.cos(angle), np.sin(angle)
        pose = [[cos, 0, sin, 3 * sin], [0, 1, 0, 0], [-sin, 0, cos, 3 * cos], [0, 0, 0, 1]]
        name = f"images/{index:03d}.png"
        Image.fromarray(generator.integers(0, 255, (18, 24, 3), np.uint8)).save(folder / name)
        time = index % 3 / 2
        frames.append({"file_path": name, "transform_matrix": pose, "time": time})
    lens = {"camera_angle_x": 0.8, "frames": frames}
    (folder / "transforms.json").write_text(json.dumps(lens))
    return folder


@pytest.fixture(scope="module")
def run(capture, tmp_path_factory):
    """A run on that data set."""
    out = tmp_path_factory.mktemp("runs") / "moving"
    arguments = ("method=spacetime", f"data={capture}", "random_points=200", "holdout_every=3")
    assert main(["train", *arguments, "steps=4", "colors=features", f"out={out}"]) == 0
    return out


@pytest.fixture(scope="module")
def model(run, tmp_path_factory):
    """Its model, far away from the run."""
    path = tmp_path_factory.mktemp("models") / "moving.gsfw"
    assert main(["export", str(run), "format=gsfw", f"out={path}"]) == 0
    return path


@pytest.fixture
def without_data(capture):
    """The data set is somewhere else meanwhile; where."""
    elsewhere = capture.with_name("elsewhere")
    shutil.move(capture, elsewhere)
    yield elsewhere
    shutil.move(elsewhere, capture)


def pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture)


def test_export_says_what_is_in_the_file(run, capsys):
    assert main(["export", str(run), "format=gsfw", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    path = run / "model.gsfw"
    assert document["written"] == str(path)
    assert document["bytes"] == path.stat().st_size
    assert (document["format"], document["num_gaussians"], document["step"]) == ("gsfw", 200, 4)


@pytest.mark.parametrize("options", ["what=orbit time=0.5", "what=time", "what=orbit-time"])
def test_films_are_those_of_the_run_without_its_data(run, model, capture, tmp_path, options):
    what = options.split()[0].removeprefix("what=")
    options = (*options.split(), "frames=2", "video=none")
    assert main(["render", str(run), *options, f"out={tmp_path / 'run'}"]) == 0
    elsewhere = capture.with_name("elsewhere")
    shutil.move(capture, elsewhere)
    try:
        assert main(["render", str(model), *options, f"out={tmp_path / 'file'}"]) == 0
    finally:
        shutil.move(elsewhere, capture)
    for index in range(2):
        first, second = (pixels(tmp_path / w / what / f"{index:04d}.png") for w in ("run", "file"))
        assert np.array_equal(first, second)
        assert first.std() > 1


def test_all_films_are_drawn_beside_the_file_where_there_are_no_photos(
    model, without_data, tmp_path
):
    copy = shutil.copy(model, tmp_path / "a.gsfw")
    assert main(["render", str(copy), "frames=1", "video=none"]) == 0
    assert sorted(path.name for path in (tmp_path / "renders").iterdir()) == [
        "orbit", "orbit-time", "time",
    ]  # fmt: skip


def test_a_splat_file_of_it_is_that_of_the_run(run, model, tmp_path):
    assert main(["export", str(run), "time=0.5", f"out={tmp_path / 'run.ply'}"]) == 0
    copy = shutil.copy(model, tmp_path / "a.gsfw")
    assert main(["export", str(copy), "time=0.5"]) == 0
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "run.ply").read_bytes()


def test_smaller_files_are_made_of_runs_and_of_model_files(run, model, tmp_path, capsys):
    small, smaller = tmp_path / "small.gsfw", tmp_path / "smaller.gsfw"
    words = ["format=gsfw", "format.precision=compressed"]
    assert main(["export", str(run), *words, f"out={small}"]) == 0
    assert main(["export", str(model), *words, "format.step=4", f"out={smaller}"]) == 0
    assert smaller.stat().st_size < small.stat().st_size < model.stat().st_size / 3
    capsys.readouterr()
    assert main(["info", str(small), "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["precision"], document["version"]) == ("compressed", 2)
    converted = tmp_path / "converted.gsfw"
    assert main(["convert", str(run), str(converted), *words[1:]]) == 0
    saved = load(run).save(tmp_path / "saved.gsfw", options={"precision": "compressed"})
    assert small.read_bytes() == converted.read_bytes() == saved.read_bytes()
    found = []
    for path in (model, small):
        out = tmp_path / path.stem
        options = ["what=orbit", "frames=1", "time=0.5", "video=none", f"out={out}"]
        assert main(["render", str(path), *options]) == 0
        found.append(pixels(out / "orbit" / "0000.png").astype(float))
    assert np.abs(found[0] - found[1]).mean() < 4


def test_info_needs_neither_the_data_nor_the_state(model, without_data, capsys):
    assert main(["info", str(model), "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["kind"] == "model file"
    assert (document["method"], document["num_gaussians"]) == ("spacetime", 200)
    assert document["cameras"] == {"train": 4, "eval": 2}
    assert document["scene"]["num_times"] == 3
    assert document["made_by"]["gsfw"]
    assert main(["info", str(model)]) == 0
    assert "moving.gsfw: model file" in capsys.readouterr().out


@pytest.mark.parametrize("verb", [["eval"], ["render", "what=views"]])
def test_what_needs_pictures_says_so(model, without_data, capsys, verb):
    assert main([*verb, str(model)]) == 2
    assert capsys.readouterr().err == (
        f"error: {model} contains no images, only the cameras that took them.\n"
        "Add data=PATH with the data set it was trained on, or render what needs no images: "
        f"gsfw render {model} what=orbit\n"
    )


def test_of_the_built_in_scene_it_is_the_run_that_has_the_pictures(tmp_path, capsys):
    out = tmp_path / "run"
    assert main(["train", "method=3dgs", *MOVING, "steps=1", "ignore_time=true", f"out={out}"]) == 0
    assert main(["export", str(out), "format=gsfw"]) == 0
    capsys.readouterr()
    assert main(["eval", str(out / "model.gsfw")]) == 2
    assert capsys.readouterr().err == (
        f"error: {out}/model.gsfw contains no images, only the cameras that took them.\n"
        "It was trained on the built-in scene, not on a data set: give the run's folder, or render "
        f"what needs no images: gsfw render {out}/model.gsfw what=orbit\n"
    )


def test_with_the_data_its_figures_are_those_of_the_run(run, model, without_data, tmp_path, capsys):
    figures = []
    for name in (str(run), str(shutil.copy(model, tmp_path / "a.gsfw"))):
        assert main(["eval", name, f"data={without_data}", "json=true"]) == 0
        document = json.loads(capsys.readouterr().out)
        figures.append([{**view} for view in document["per_view"]])
    assert figures[0] == figures[1]


def test_a_run_whose_data_moved_says_where_it_was_and_what_to_do(
    run, capture, without_data, capsys
):
    (run / "model.gsfw").unlink(missing_ok=True)
    assert main(["export", str(run)]) == 2
    assert capsys.readouterr().err == (
        f"error: {run} was trained on {capture}, and there is no such file or folder any more.\n"
        "Say where the data set is now: data=PATH. "
        f"Or look at the splats without it: gsfw view {run}/splats.ply.\n"
    )
    assert main(["export", str(run), f"data={without_data}", "format=gsfw"]) == 0
    capsys.readouterr()
    assert main(["eval", str(run)]) == 2
    told = capsys.readouterr().err
    assert f"without it: gsfw view {run}/model.gsfw." in told


def test_a_model_file_cannot_go_on_and_holds_one_state(model, capsys):
    assert main(["resume", str(model)]) == 2
    assert capsys.readouterr().err == (
        f"error: {model} cannot be resumed: a model file has no optimizer and no images.\n"
        "Give the folder of the run that it was exported from.\n"
    )
    assert main(["export", str(model), "step=2"]) == 2
    assert capsys.readouterr().err == (
        f"error: step=2: {model} holds one state, that after 4 steps.\n"
        "Leave step out, or give the run that it was exported from.\n"
    )
    assert main(["export", str(model), "format=gsfw"]) == 2
    assert "is a model file already." in capsys.readouterr().err
    assert main(["export", str(model), "format=gsfw", "time=0.5"]) == 2
    assert "format=gsfw holds the model at all times" in capsys.readouterr().err


def test_a_damaged_file_is_one_message_for_every_verb(model, tmp_path, capsys):
    path = tmp_path / "cut.gsfw"
    path.write_bytes(model.read_bytes()[:5000])
    for verb in ("info", "render", "export", "eval"):
        assert main([verb, str(path)]) == 2
        assert capsys.readouterr().err == (
            f"error: {path} is damaged: File is not a zip file.\n"
            "It may have been cut short or changed in copying; get it again.\n"
        )


def test_state_that_no_file_can_hold_is_named(run, tmp_path, capsys, monkeypatch):
    def with_text(self, **nested):
        state = torch.nn.Module.state_dict(self, **nested)
        return state if nested else {**state, "note": "text"}

    monkeypatch.setattr(PrimitiveModel, "state_dict", with_text)
    path = tmp_path / "a.gsfw"
    assert main(["export", str(run), "format=gsfw", f"out={path}"]) == 2
    assert capsys.readouterr().err == (
        f"error: {path}: format gsfw cannot hold this model: its note is no tensor but a str.\n"
    )
    assert not path.exists()


def test_the_lines_of_numpy_in_the_document_read_it(run, model, capture, tmp_path, monkeypatch):
    (lines,) = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    shutil.copy(model, "model.gsfw")
    found = {}
    exec(lines, found)
    restored = restore(RunFolder(run), installed())
    parts, scene = restored.composition.parts, restored.composition.scene
    world = transform_splats(parts.model.canonical.splats(), scene.world_from_scene)
    assert np.allclose(found["world"], world.means.detach(), atol=1e-5)
    assert np.allclose(found["opacities"], world.opacities.detach(), atol=1e-6)
    assert np.allclose(found["sizes"], world.scales.detach(), rtol=1e-5)
    assert found["colors"].shape == (200, 3)


def test_the_document_names_every_field_of_the_header_and_every_column(model):
    header = json.loads(np.load(model)["header.json"])
    text = DOCUMENT.read_text()
    for key in (*header, *header["scene"], *header["render"], *header["cameras"][0]):
        assert re.search(rf"[`.]{key}[`.]", text), key
    for name in header["columns"]:
        assert f"`{name}`" in text, name


def test_a_file_of_a_newer_gsfw_says_which(model, tmp_path, capsys):
    from gsfw.formats.array_archive import ArrayArchive, write_archive

    header = {"format": "gsfw model", "version": 3, "gsfw": "9.1"}
    write_archive(tmp_path / "new.gsfw", ArrayArchive(header, {}))
    assert main(["info", str(tmp_path / "new.gsfw")]) == 2
    said = capsys.readouterr().err
    assert "new.gsfw is in version 3 of the format; this gsfw reads 2.\n" in said
    assert "It was written by gsfw 9.1; this is " in said


def test_splat_files_at_many_times_hold_the_model_then(run, tmp_path):
    from gsfw.plugins.snapshot import snapshot

    assert main(["export", str(run), "times=3", f"out={tmp_path}"]) == 0
    index = json.loads((tmp_path / "times.json").read_text())
    assert [entry["time"] for entry in index["files"]] == [0.0, 0.5, 1.0]
    restored = restore(RunFolder(run), installed())
    parts, scene = restored.composition.parts, restored.composition.scene
    for entry in index["files"]:
        read = PlyImporter().read(tmp_path / entry["file"])
        expected = snapshot(parts.model, scene, False, torch.tensor(entry["time"])).splats
        assert entry["splats"] == len(expected)
        unit = torch.nn.functional.normalize(expected.quats, dim=1)
        for name, tensor in replace(expected, quats=unit, extra=None).tensors().items():
            # What a PLY holds, logits and logarithms, is rounded to float32.
            assert torch.allclose(read.splats.tensors()[name], tensor, rtol=1e-6, atol=1e-7), name
        assert torch.equal(read.splats.means.float(), expected.means.float())
        PlyExporter().write(tmp_path / "again.ply", read)
        assert (tmp_path / "again.ply").read_bytes() == (tmp_path / entry["file"]).read_bytes()
