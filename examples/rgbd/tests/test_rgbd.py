"""The format, the loss and the room, on a sequence of a few small images."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
import torch
from gsfw_rgbd.data import TumConfig, read_list, world_to_camera
from gsfw_rgbd.method import flatness
from gsfw_rgbd.room import write_room

from gsfw.api import DataError, DataRequest, Split
from gsfw.testing import conformance

FOLDER = tempfile.TemporaryDirectory()  # Removed at the end of the tests.
ROOM = Path(FOLDER.name) / "room"
write_room(ROOM, frames=9, width=48, noise=0.0)

test_conforms = conformance("plugin", "gsfw-rgbd", data=ROOM)


@pytest.fixture
def room():
    """A sequence without noise."""
    return ROOM


def train(folder, *arguments):
    command = [sys.executable, "-m", "gsfw", "train", *arguments, f"out={folder}", "json=true"]
    found = subprocess.run(
        [*command, "device=cpu", "report=false"], capture_output=True, text=True, check=True
    )
    return json.loads(found.stdout)


def test_the_format_is_recognised_by_its_three_lists(room, tmp_path):
    assert TumConfig.detect(room).recognised
    assert not TumConfig.detect(tmp_path).recognised


def test_points_lie_on_the_surfaces_that_every_depth_map_shows(room):
    data = TumConfig(points=500).build(DataRequest(room))
    (batch,) = data.load(Split.EVAL, [0], torch.device("cpu"))
    points, cameras = data.scene.points, batch.cameras
    pose, matrix = cameras.world_to_camera[0], cameras.intrinsics[0]
    x, y, z = (points @ pose[:3, :3].T + pose[:3, 3]).unbind(1)
    u, v = (matrix[0, 0] * x / z + matrix[0, 2]).long(), (matrix[1, 1] * y / z + 18.0).long()
    inside = (z > 0) & (u >= 0) & (u < 48) & (v >= 0) & (v < 36)
    measured = batch.maps["depth"].values[0, v[inside], u[inside], 0]
    # Points may be hidden, never before the surface (by more than a pixel's slope).
    before = measured - z[inside]
    assert float(before.quantile(0.95)) < 0.05 * data.scene.extent
    assert float(before.abs().median()) < 0.03 * data.scene.extent


def test_held_out_images_bring_no_points(room):
    data = TumConfig(points=400, held_out_every=2).build(DataRequest(room))
    assert len(data.views(Split.EVAL)) == 5
    assert len(data.scene.points) == 400


def test_a_pose_leads_from_the_world_into_the_camera():
    half_turn = world_to_camera((1.0, 2.0, 3.0, 0.0, 0.0, 1.0, 0.0), "here")  # About z.
    point = torch.tensor([2.0, 2.0, 3.0, 1.0], dtype=torch.float64)
    assert torch.allclose(half_turn @ point, point.new_tensor([-1.0, 0.0, 0.0, 1.0]))


def test_the_row_nearest_in_time_is_taken_whatever_the_order_of_the_lines(tmp_path):
    times = [0.5, 0.1, 0.3, 0.31]
    lines = [f"{time} {place}.png" for place, time in enumerate(times)]
    (tmp_path / "depth.txt").write_text("\n".join(["# Tiefe, grün", *lines]), encoding="utf-8")
    rows = read_list(tmp_path / "depth.txt")
    assert list(rows) == sorted(times)
    table, config = (list(rows), list(rows.values())), TumConfig(longest_gap=0.05)
    found = [config._nearest(table, time) for time in (0.0, 0.06, 0.304, 0.306, 0.4, 0.5, 0.6)]
    assert found == [None, ["1.png"], ["2.png"], ["3.png"], None, ["0.png"], None]
    assert config._nearest(([], []), 0.1) is None


def test_a_damaged_line_is_named(room, tmp_path):
    for name in ("rgb.txt", "depth.txt"):
        (tmp_path / name).write_text((room / name).read_text())
    (tmp_path / "groundtruth.txt").write_text("0.0 1 2 3\n")
    with pytest.raises(DataError) as caught:
        TumConfig().recording(tmp_path, 1.0)
    assert "groundtruth.txt:1: expected a time and seven numbers" in str(caught.value)


def test_edges_of_the_image_weigh_less():
    images = torch.zeros(1, 4, 6, 3)
    images[:, :, 3:] = 1.0
    weights = flatness(images)[0, 0, :, 0]
    assert torch.equal(weights[[0, 1, 3, 4, 5]], torch.ones(5))
    assert float(weights[2]) < 0.5


def test_depth_is_learned_and_measured_on_held_out_views(room, tmp_path):
    few = (f"data={room}", "steps=80", "init=random", "random_points=500", "strategy=none")
    plain = train(tmp_path / "plain", "method=3dgs-depth", "depth_weight=0", *few)
    held = train(tmp_path / "held", "method=3dgs-depth", "depth_weight=1", *few)
    assert held["depth_error"] < 0.8 * plain["depth_error"]
