"""`gsfw export RUN format=mesh`: the surface of a run as triangles, in the world of its data."""

import json

import numpy as np
import pytest
import torch
from plyfile import PlyData
from support.true_surface import distances, true_surface

from gsfw.commands.main import main
from gsfw.core.datamanager import Split
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore
from gsfw.plugins.run_source import RunSource


def test_a_run_is_written_as_a_mesh_and_its_size_is_told(finished_run, tmp_path, capsys):
    out = tmp_path / "a.ply"
    arguments = ["export", str(finished_run), "format=mesh", f"out={out}", "format.resolution=32"]
    assert main([*arguments, "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert (document["written"], document["bytes"]) == (str(out), out.stat().st_size)
    assert len(PlyData.read(out)["face"].data) > 100
    assert main([*arguments, "times=3"]) == 2
    assert "format=mesh is written at one time: leave out times." in capsys.readouterr().err


def test_suffixes_and_voxels_that_do_not_fit_are_named(finished_run, tmp_path, capsys):
    for name, given, expected in (
        ("a.stl", "format.resolution=32", "format=mesh writes .ply, .obj, .glb, and no file such"),
        ("a.ply", "format.voxel=1e-12", "format.voxel=1e-12: the surfaces are"),
        ("a.ply", "format.voxel=1000", "format.voxel=1000 is larger than the surfaces, whose"),
    ):
        arguments = ["export", str(finished_run), "format=mesh", f"out={tmp_path / name}", given]
        assert main(arguments) == 2
        assert expected in capsys.readouterr().err
    assert list(tmp_path.glob("a.*")) == []


def test_depth_views_are_in_the_world_of_the_data(finished_run):
    restored = restore(RunFolder(finished_run), installed())
    views = RunSource(restored).depth_views()
    world = restored.composition.scene.world_from_scene
    cameras = restored.composition.parts.data.views(Split.TRAIN).cameras
    assert len(views) == len(cameras)
    for view, camera in zip(views, cameras, strict=True):
        assert torch.allclose(view.camera.centers, world.apply(camera.centers), atol=1e-5)
        assert view.depth.shape == view.alpha.shape == view.color.shape[:2]
        assert view.up == "z"


@pytest.mark.slow
def test_the_mesh_of_the_built_in_scene_is_near_its_true_surface(tmp_path):
    """The scene is 3 wide, and a pixel of its images about 0.02 there."""
    run, out = tmp_path / "run", tmp_path / "a.ply"
    size = ("datamanager.width=160", "datamanager.height=120", "datamanager.views=20")
    settings = ("steps=150", *size, "report=false", "device=cpu")
    assert main(["train", "method=3dgs", *settings, f"out={run}"]) == 0
    assert main(["export", str(run), "format=mesh", f"out={out}"]) == 0
    vertices = PlyData.read(out)["vertex"].data
    places = np.stack([vertices[axis] for axis in "xyz"], axis=1)
    found = distances(places, true_surface(40, 320, 240))
    assert found.accuracy[0] < 0.02
    assert found.accuracy[1] < 0.08
    assert found.completeness[1] < 0.08
