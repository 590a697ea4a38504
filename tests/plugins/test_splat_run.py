"""A file of splats in place of a run."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from PIL import Image

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.loop.evaluation import render_model
from gsfw.formats.ply import PlyImporter
from gsfw.plugins.registry import installed


@pytest.fixture(scope="module")
def splat_file(finished_run, tmp_path_factory):
    """The splats of a small run, in the world of its data."""
    out = tmp_path_factory.mktemp("splats") / "splats.ply"
    assert main(["export", str(finished_run), "format=ply", f"out={out}"]) == 0
    return SimpleNamespace(run=finished_run, file=out)


def test_the_splats_are_those_of_the_run_in_another_frame(splat_file):
    ours = restore_run(find_run(str(splat_file.file), print, splats=True), installed())
    theirs = restore_run(find_run(str(splat_file.run), print), installed())
    camera = theirs.composition.parts.data.views(Split.EVAL).cameras[0]
    to_world = theirs.composition.scene.world_from_scene
    to_ours = ours.composition.scene.world_from_scene.inverse()
    pose = to_ours.camera(to_world.camera(camera.world_to_camera.double())).float()
    settings = theirs.composition.plan.settings
    images = [
        render_model(run.composition.parts.model, run.composition.parts.rasterizer, one, settings)
        for run, one in (
            (theirs, camera),
            (ours, type(camera)(pose, camera.intrinsics, camera.width, camera.height)),
        )
    ]
    difference = (images[0].color - images[1].color).abs()
    assert float(difference.mean()) < 0.002


def test_a_splat_file_is_rendered_from_all_around(splat_file, tmp_path, capsys):
    arguments = ["frames=2", "width=48", "video=none", f"out={tmp_path}", "json=true"]
    assert main(["render", str(splat_file.file), *arguments]) == 0
    written = json.loads(capsys.readouterr().out)["written"]
    images = []
    for file in written:
        with Image.open(file) as picture:
            images.append(np.asarray(picture).astype(int))
    assert [image.shape for image in images] == [(27, 48, 3)] * 2
    assert all(image.max() > 60 for image in images)
    assert not np.array_equal(*images)


def test_a_splat_file_has_no_photos(splat_file, tmp_path, capsys):
    assert main(["render", str(splat_file.file), "what=views", f"out={tmp_path}"]) == 2
    assert "holds splats, and no images to compare with" in capsys.readouterr().err


def test_another_file_is_no_splats(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("nothing")
    assert main(["render", str(tmp_path / "notes.txt")]) == 2
    assert "is not a splat file that can be read here" in capsys.readouterr().err


def test_one_splat_has_cameras_too(tmp_path):
    names = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1"]
    names += ["scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    header = "ply\nformat ascii 1.0\nelement vertex 1\n"
    header += "".join(f"property float {name}\n" for name in names) + "end_header\n"
    (tmp_path / "one.ply").write_text(header + "5 5 5 1 1 1 3 -3 -3 -3 1 0 0 0\n")
    run = restore_run(find_run(str(tmp_path / "one.ply"), print, splats=True), installed())
    cameras = run.composition.parts.data.views(Split.TRAIN).cameras
    assert bool(torch.cat([camera.world_to_camera for camera in cameras]).isfinite().all())


def test_a_splat_file_is_read_once(splat_file, monkeypatch):
    reads = []
    read = PlyImporter.read
    monkeypatch.setattr(
        PlyImporter, "read", lambda self, path: reads.append(path) or read(self, path)
    )
    restored = restore_run(find_run(str(splat_file.file), print, splats=True), installed())
    assert reads == [splat_file.file]
    assert restored.composition.parts.model.num_rows == len(read(PlyImporter(), reads[0]).splats)


def test_rows_that_were_not_read_are_told(splat_file, tmp_path, capsys):
    raw = splat_file.file.read_bytes()
    start = raw.index(b"end_header\n") + len(b"end_header\n")
    broken = tmp_path / "broken.ply"
    broken.write_bytes(raw[:start] + np.float32(np.nan).tobytes() + raw[start + 4 :])
    told = "1 row of the file is left out: its values are not all finite."
    arguments = ["frames=1", "width=24", "video=none", f"out={tmp_path}"]
    assert main(["render", str(broken), *arguments]) == 0
    assert capsys.readouterr().err.splitlines() == [f"warning: {told}"]
    assert main(["info", str(broken), "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["num_dropped"], document["notes"]) == (1, [told])
    assert main(["render", str(splat_file.file), *arguments]) == 0
    assert "left out" not in capsys.readouterr().err
