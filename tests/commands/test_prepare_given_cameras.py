"""`gsfw prepare` of data sets that have cameras: they are kept."""

import json
from shutil import copytree

import numpy as np
import pytest
from PIL import Image
from support import captured
from support.small_captures import opengl, ring, write_images, write_transforms

from gsfw.commands import train
from gsfw.commands.interface.arguments import parse
from gsfw.commands.interface.console import Console
from gsfw.commands.main import main
from gsfw.core.datamanager import DataRequest, Split
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.point_file import read_points
from gsfw.preparation.check import plan


def write_arc(folder, places=6):
    """Six photos of the built-in scene from places on an arc, with their cameras."""
    cameras = captured.arc(6, step=8.0, width=96, height=72)
    cameras = cameras.select([number % places for number in range(6)])
    paths = captured.write(folder / "images", captured.photos(cameras))
    focal = float(cameras.intrinsics[0, 0, 0])
    frames = [
        {"file_path": f"images/{path.name}", "transform_matrix": opengl(pose.numpy())}
        for path, pose in zip(paths, cameras.world_to_camera, strict=True)
    ]
    lens = {"fl_x": focal, "fl_y": focal, "cx": 48, "cy": 36, "w": 96, "h": 72}
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
    return folder


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    """Such photos, and a data set that was made of them."""
    folder = tmp_path_factory.mktemp("arc")
    source, out = write_arc(folder / "a"), folder / "out"
    assert main(["prepare", str(source), f"out={out}"]) == 0
    return source, out


@pytest.fixture
def arc(prepared, tmp_path):
    """The photos, and a copy of the data set that a test may write to."""
    return prepared[0], copytree(prepared[1], tmp_path / "copy")


@pytest.mark.slow
def test_points_of_all_surfaces_are_written_beside_the_data_set(arc, tmp_path, capsys):
    main(["prepare", str(arc[0]), f"out={tmp_path / 'out'}", "dense=true"])
    assert "surface points: " in capsys.readouterr().out
    points, colors = read_points(tmp_path / "out" / "dense.ply", "dense")
    assert len(points) > 1000
    table = points[:, 2].abs() < 0.05
    assert table.float().mean() > 0.5, "most of an image shows the table, at z = 0"
    assert colors.std() > 0.05


def test_a_capture_from_one_place_has_no_dense_points(tmp_path, capsys):
    source = write_arc(tmp_path / "a", places=1)
    main(["prepare", str(source), f"out={tmp_path / 'out'}", "dense=true"])
    said = capsys.readouterr().out
    assert ("note: no dense.ply: " in said) != ("will not train" in said)
    assert not (tmp_path / "out" / "dense.ply").exists()


@pytest.fixture
def trained(monkeypatch):
    """The words that each training was started with; the training only prints a document."""
    started = []

    def start(words):
        started.append(words)
        Console(parse(words).flag("json")).result({"trained": True})
        return 0

    monkeypatch.setattr(train, "run", start)
    return started


@pytest.mark.slow
def test_a_planned_run_is_suggested_no_size_of_images(arc, capsys, monkeypatch, trained):
    monkeypatch.setattr(plan, "LONG_SIDE", 80)  # The photos have 96 pixels.
    source, out = arc
    words = ["prepare", str(source), f"out={out}"]
    assert main(words) == 0
    assert "next: gsfw train method=3dgs data=" in capsys.readouterr().out
    report = json.loads((out / "prepare.json").read_text())
    assert "downscale" not in report["next"]
    assert report["suggested"]["downscale"] == "2"
    assert main([*words, "train=true", "steps=9"]) == 0
    assert main([*words, "train=true", "minutes=1"]) == 0
    assert ["downscale=2" in words for words in trained] == [True, False]


@pytest.mark.parametrize("last", ["train=true --json", "json=true train=true"])
def test_the_document_of_the_training_is_alone_on_standard_output(arc, capsys, trained, last):
    source, out = arc
    assert main(["prepare", str(source), f"out={out}", *last.split()]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out) == {"trained": True}
    assert "verdict: " in said.err


def test_a_data_set_with_cameras_keeps_them(tmp_path, capsys):
    write_images(tmp_path / "a", ring())
    write_transforms(tmp_path / "a" / "transforms.json", ring())
    code = main(["prepare", str(tmp_path / "a"), f"out={tmp_path / 'out'}"])
    said = capsys.readouterr().out
    assert "has cameras already (transforms): they are kept; poses=compute makes new ones" in said
    report = json.loads((tmp_path / "out" / "prepare.json").read_text())
    assert code == (1 if report["verdict"] == "will not train" else 0)
    assert report["format"] == "transforms"
    assert (tmp_path / "out" / "sparse" / "0" / "cameras.bin").is_file()
    data = ColmapConfig().build(DataRequest(tmp_path / "out", eval_every_nth=0))
    assert len(data.views(Split.TRAIN)) == len(ring().poses)
    data.close()


def test_a_data_set_with_cameras_needs_no_cluster(tmp_path, capsys):
    write_images(tmp_path / "a", ring())
    write_transforms(tmp_path / "a" / "transforms.json", ring())
    words = [str(tmp_path / "a"), f"out={tmp_path / 'out'}", "executor=ray"]
    assert main(["prepare", *words]) == 2
    assert capsys.readouterr().err == (
        f"error: executor=ray: {tmp_path / 'a'} has cameras already, which are kept.\n"
        "Leave it out, or compute new cameras with poses=compute.\n"
    )


def test_a_data_set_with_depths_keeps_them(tmp_path):
    write_images(tmp_path / "a", ring())
    Image.fromarray(np.full((48, 64), 2000, np.uint16)).save(tmp_path / "a" / "depth.png")
    settings = [{"depth_file_path": "depth.png"} for _ in ring().poses]
    write_transforms(tmp_path / "a" / "transforms.json", ring(), settings)
    main(["prepare", str(tmp_path / "a"), f"out={tmp_path / 'out'}"])
    depths = [path.read_bytes() for path in (tmp_path / "out" / "depths").iterdir()]
    assert depths == len(ring().poses) * [(tmp_path / "a" / "depth.png").read_bytes()]
