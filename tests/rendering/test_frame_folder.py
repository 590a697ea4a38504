"""Frames on disk that belong to a request."""

import json

from support.moving_scene import camera_at, two_balls

from gsfw.rendering.frame_folder import FrameFolder, cameras_digest, model_digest

NAMES = ["0000.png", "0001.png"]


def started(path, request, names=NAMES, scales=None):
    folder = FrameFolder(path, request, names)
    folder.start(scales or {})
    return folder


def test_a_frame_of_the_same_request_is_kept(tmp_path):
    started(tmp_path, {"channels": ["color"]}, scales={"depth": (1.0, 2.0)})
    (tmp_path / "0000.png").write_bytes(b"whole")
    again = FrameFolder(tmp_path, {"channels": ["color"]}, NAMES)
    assert [again.has(name) for name in NAMES] == [True, False]
    assert again.kept == 1
    assert again.scales == {"depth": (1.0, 2.0)}


def test_frames_of_another_request_are_removed_and_no_other_file(tmp_path):
    started(tmp_path, {"channels": ["color"]})
    for name in (*NAMES, "mine.png"):
        (tmp_path / name).write_bytes(b"")
    other = FrameFolder(tmp_path, {"channels": ["depth"]}, ["0000.png"])
    assert other.kept == 0
    assert other.scales is None
    assert (tmp_path / "0000.png").exists(), "nothing changes before it starts"
    other.start({})
    assert sorted(item.name for item in tmp_path.iterdir()) == ["frames.json", "mine.png"]


def test_a_manifest_that_leads_elsewhere_removes_nothing(tmp_path):
    (tmp_path / "precious").write_text("")
    inside = tmp_path / "frames"
    started(inside, {}, ["../precious"])
    started(inside, {"other": 1})
    assert (tmp_path / "precious").exists()


def test_names_of_an_earlier_run_that_are_no_files_are_passed_over(tmp_path):
    started(tmp_path, {}, ["folder", "x" * 5000, "a\0b"])
    (tmp_path / "folder").mkdir()
    started(tmp_path, {"other": 1})
    assert (tmp_path / "folder").is_dir()


def test_a_damaged_manifest_is_as_none(tmp_path):
    for content in ("", "[]", "{}", json.dumps({"request": {}, "scales": 3})):
        (tmp_path / "frames.json").write_text(content)
        (tmp_path / "0000.png").write_bytes(b"")
        assert FrameFolder(tmp_path, {}, NAMES).kept == 0


def test_a_model_and_cameras_are_known_by_their_values():
    model, other = two_balls(), two_balls(velocity=0.7)
    assert model_digest(model) == model_digest(two_balls())
    assert model_digest(model) != model_digest(other)
    assert cameras_digest([camera_at(0.5)]) == cameras_digest([camera_at(0.5)])
    assert cameras_digest([camera_at(0.5)]) != cameras_digest([camera_at(0.4)])
    assert cameras_digest([camera_at(None)]) != cameras_digest([camera_at(None)] * 2)
