"""Tests of data manager my-part."""

import json
import math
import tempfile
from pathlib import Path

import pytest
from gsfw.api import DataError
from gsfw.testing import conformance
from PIL import Image

from my_part import datamanager


def capture(folder: Path, views: int = 8) -> Path:
    """A data set of small images, of cameras on a circle that look at its middle."""
    frames = []
    for i in range(views):
        angle = 2 * math.pi * i / views
        c, s = math.cos(angle), math.sin(angle)
        pose = [[c, 0, -s, 0], [0, 1, 0, 0], [s, 0, c, 3], [0, 0, 0, 1]]
        Image.new("RGB", (32, 24), (30 * i, 100, 200)).save(folder / f"{i:03}.png")
        lens = {"fx": 30, "fy": 30, "cx": 16, "cy": 12}
        frames.append({"image": f"{i:03}.png", **lens, "world_to_camera": pose})
    (folder / datamanager.POSES).write_text(json.dumps({"frames": frames}))
    return folder


FOLDER = tempfile.TemporaryDirectory()
DATA = capture(Path(FOLDER.name))

test_conforms = conformance("datamanager", "my-part", data=DATA)


def test_cameras_and_images_are_read():
    recording = datamanager.MyPartConfig().recording(DATA, downscale=1)
    assert len(recording.frames) == 8
    assert recording.frames[0].world_to_camera[:3, 3].tolist() == [0, 0, 3]


def test_a_camera_that_is_no_transform_is_named(tmp_path):
    content = json.loads((capture(tmp_path) / datamanager.POSES).read_text())
    content["frames"][2]["world_to_camera"][0][0] = 5
    (tmp_path / datamanager.POSES).write_text(json.dumps(content))
    with pytest.raises(DataError, match="frame 2: the pose is not rigid"):
        datamanager.MyPartConfig().recording(tmp_path, downscale=1)
