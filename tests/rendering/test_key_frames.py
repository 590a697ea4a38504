"""Camera path files: ours, and those of other tools."""

import json
import math
from pathlib import Path

import pytest
import torch

from gsfw.core.errors import DataError
from gsfw.rendering.key_frames import (
    CameraPath,
    KeyFrame,
    camera_path_of,
    path_frames,
    write_camera_path,
)
from gsfw.rendering.path_files import read_path_file


def standing_at(*place):
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, 3] = torch.tensor(place, dtype=torch.float64)
    return pose


def three(**settings):
    keys = tuple(
        KeyFrame(standing_at(x, 0.0, 0.0), 40.0 + 10 * x, time=x / 2) for x in (0.0, 1.0, 2.0)
    )
    return CameraPath(keys, **settings)


def written(tmp_path, document, name="path.json"):
    file = tmp_path / name
    file.write_text(json.dumps(document))
    return file


def test_a_path_of_too_many_frames_is_refused(tmp_path):
    path = three(fps=1000.0, seconds=1e5)
    with pytest.raises(DataError, match=r"would have 100,000,000 frames: 100000 s at 1000 per"):
        read_path_file(write_camera_path(tmp_path / "path.json", path))


def test_a_path_is_read_as_it_was_written(tmp_path):
    path = three(fps=10.0, seconds=1.5, width=320, height=180)
    found = read_path_file(write_camera_path(tmp_path / "a" / "path.json", path))
    assert found.camera_to_world.shape == (15, 4, 4)
    assert (found.fps, found.width, found.height) == (10.0, 320, 180)
    assert torch.equal(found.camera_to_world, path_frames(path).camera_to_world)
    assert found.camera_to_world[:, 0, 3].tolist() == pytest.approx(
        torch.linspace(0, 2, 15).tolist(), abs=1e-4
    )
    assert found.fovs.tolist() == pytest.approx(torch.linspace(40, 60, 15).tolist(), abs=0.01)
    assert found.times is not None
    assert found.times.tolist() == pytest.approx(torch.linspace(0, 1, 15).tolist(), abs=1e-4)


def test_the_number_of_frames_can_be_chosen(tmp_path):
    assert len(read_path_file(write_camera_path(tmp_path / "p.json", three()), 7).fovs) == 7


def test_key_frames_are_passed_at_their_seconds():
    keys = tuple(
        KeyFrame(standing_at(x, 0.0, 0.0), 50.0, seconds=at)
        for x, at in ((0.0, 0.0), (1.0, 3.0), (2.0, 4.0))
    )
    found = path_frames(CameraPath(keys, fps=10.0), 41).camera_to_world[:, 0, 3]
    assert found[[0, 30, 40]].tolist() == pytest.approx([0, 1, 2], abs=1e-9)
    assert len(path_frames(CameraPath(keys, fps=10.0)).fovs) == 40
    closed = path_frames(CameraPath(keys, fps=10.0, seconds=6.0, closed=True))
    assert len(closed.fovs) == 60
    assert float(closed.camera_to_world[-1, 0, 3]) < 0.3


def test_time_passes_while_the_camera_stands_still():
    keys = tuple(KeyFrame(standing_at(1.0, 0, 0), 50.0, time) for time in (0.0, 0.5, 1.0))
    found = path_frames(CameraPath(keys), 5)
    assert found.times is not None
    assert found.times.tolist() == pytest.approx([0, 0.25, 0.5, 0.75, 1])


def test_a_closed_path_ends_before_its_first_frame():
    found = path_frames(three(closed=True, seconds=2.0)).camera_to_world[:, 0, 3]
    assert len(found) == 60
    assert 0 < float(found[-1]) < 0.2
    assert float(found.max()) == pytest.approx(2.0, abs=0.2)


def test_a_path_of_nerfstudio_is_in_the_axes_and_the_place_of_the_data(tmp_path, caplog):
    opengl = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0]))
    opengl[0, 3] = 3.0
    cameras = [
        {"camera_to_world": opengl.flatten().tolist(), "fov": 50.0, "aspect": 1.5, "render_time": t}
        for t in (0.0, 1.0)
    ]
    document = {"camera_path": cameras, "fps": 24, "render_width": 96, "render_height": 64}
    file = written(tmp_path, document, "camera_path.json")
    found = read_path_file(file)
    assert torch.allclose(found.camera_to_world[0], standing_at(3.0, 0, 0))
    assert "dataparser_transforms.json" in caplog.text
    assert (found.fps, found.width, found.height) == (24, 96, 64)
    assert found.times is not None
    assert found.times.tolist() == [0, 1]
    # Its world is p' = scale (R p + t).
    placed = {"transform": [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0]], "scale": 0.5}
    written(tmp_path, placed, "dataparser_transforms.json")
    assert torch.allclose(read_path_file(file).camera_to_world[0], standing_at(5.0, 0, 0))
    resampled = read_path_file(file, 5)
    assert resampled.times is not None
    assert resampled.times.tolist() == pytest.approx([0, 0.25, 0.5, 0.75, 1])


def test_the_cameras_of_transforms_json_are_a_path(tmp_path):
    opengl = torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0])).tolist()
    frames = [{"file_path": f"{n}.png", "transform_matrix": opengl, "time": n} for n in range(3)]
    blender = {"camera_angle_x": math.radians(60), "frames": frames}
    found = read_path_file(written(tmp_path, blender))
    assert torch.allclose(found.camera_to_world, torch.eye(4, dtype=torch.float64).expand(3, 4, 4))
    assert found.fovs.tolist() == pytest.approx([60] * 3)
    assert found.times is not None
    assert found.times.tolist() == [0, 0.5, 1]
    sized = {**blender, "w": 200, "h": 100, "fl_x": 50.0}
    assert read_path_file(written(tmp_path, sized)).fovs.tolist() == pytest.approx([90] * 3)


BROKEN = {
    "is no camera path": {"cameras": []},
    "has no key frames": {"schema": 1, "key_frames": []},
    "expected a camera path of schema 1, found 9": {"schema": 9, "key_frames": [{}]},
    r"key_frames\[0\]: camera_to_world is missing": {"schema": 1, "key_frames": [{"fov": 50}]},
    r"key_frames\[1\]: camera_to_world\[0\]\[3\]: expected one finite number": {
        "schema": 1,
        "key_frames": [
            {"fov": 50, "camera_to_world": torch.eye(4).tolist()},
            {"fov": 50, "camera_to_world": [[1, 0, 0, 10**400]] * 4},
        ],
    },
    "fps: expected one finite number, found 1000": {
        "schema": 1, "fps": 10**400,
        "key_frames": [{"fov": 50, "camera_to_world": torch.eye(4).tolist()}],
    },
    "expected a rotation and a position": {
        "schema": 1, "key_frames": [{"fov": 50, "camera_to_world": [[1.0] * 4] * 4}],
    },
    "fov: expected a number from 0.1 to 179, found 500": {
        "schema": 1, "key_frames": [{"fov": 500, "camera_to_world": torch.eye(4).tolist()}],
    },
    "time: expected a number from 0 to 1, found 2": {
        "schema": 1,
        "key_frames": [{"fov": 50, "time": 2, "camera_to_world": torch.eye(4).tolist()}],
    },
    "some of its key frames have a time, and others none": {
        "schema": 1,
        "key_frames": [
            {"fov": 50, "time": at, "camera_to_world": torch.eye(4).tolist()} for at in (0, None)
        ],
    },
    r"frames\[1\]: time: expected one finite number, found 'soon'": {
        "camera_angle_x": 1.0,
        "frames": [
            {"transform_matrix": torch.eye(4).tolist(), "time": at} for at in (0, "soon")
        ],
    },
    r"frames\[0\]: h: expected one finite number, found 'tall'": {
        "fl_y": 50.0,
        "frames": [{"transform_matrix": torch.eye(4).tolist(), "h": "tall"}],
    },
    r"frames\[0\] has no field of view": {
        "frames": [{"transform_matrix": torch.eye(4).tolist()}],
    },
    "is no camera path.": {"camera_path": [{"camera_to_world": torch.eye(4).tolist()}, 7]},
    "seconds of its key frames do not ascend": {
        "schema": 1,
        "key_frames": [
            {"fov": 50, "seconds": at, "camera_to_world": torch.eye(4).tolist()} for at in (1, 0)
        ],
    },
}  # fmt: skip


@pytest.mark.parametrize("message", BROKEN)
def test_a_broken_file_says_what_is_wrong(tmp_path, message):
    with pytest.raises(DataError, match=message):
        read_path_file(written(tmp_path, BROKEN[message]))


def test_a_list_at_the_top_is_no_camera_path(tmp_path):
    with pytest.raises(DataError, match="no key frames") as caught:
        camera_path_of([1, 2], Path("path.json"))
    assert "path.json" in caught.value.message
    (tmp_path / "list.json").write_text("[1, 2]")
    with pytest.raises(DataError, match="is no camera path"):
        read_path_file(tmp_path / "list.json")


def test_a_file_that_is_no_json_or_not_there_says_so(tmp_path):
    (tmp_path / "text.json").write_text("nothing")
    with pytest.raises(DataError, match="cannot be read as JSON"):
        read_path_file(tmp_path / "text.json")
    with pytest.raises(DataError, match="there is no such file"):
        read_path_file(tmp_path / "none.json")
