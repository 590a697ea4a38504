"""Data sets of videos: times of frames, and the file that keeps them."""

from dataclasses import replace

import pytest
import torch
from support.distorted_images import lens
from support.estimated_cameras import VIEWS, estimate, frames, loaded, photos
from support.small_captures import request

from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.preparation.image_set import ImageSet
from gsfw.preparation.writing.data_set import write_data_set
from gsfw.preparation.writing.image_output import OutputRule
from gsfw.preparation.writing.written_files import is_all_there


def test_frames_of_a_video_keep_their_times_in_a_transforms_file(tmp_path):
    camera = lens("OPENCV")
    taken, estimated = photos(tmp_path / "frames"), estimate(camera)
    timed = [replace(one, time=0.5 * number) for number, one in enumerate(taken.images)]
    whole = write_data_set(estimated, taken, tmp_path / "out", OutputRule())
    before = loaded(tmp_path / "out").recording
    found = write_data_set(
        estimated, ImageSet(tuple(timed)), tmp_path / "out", OutputRule(), layout="transforms"
    )
    assert (found.layout, found.notes) == ("transforms", ())
    assert (found.images, found.points) == (whole.images, whole.points)
    assert not (tmp_path / "out/sparse").exists()
    assert is_all_there(tmp_path / "out")
    read = TransformsConfig().build(request(tmp_path / "out"))
    after = read.recording
    assert [frame.time for frame in after.frames] == [0.0, 0.5, 1.0, 1.5]
    assert read.scene.num_times == VIEWS
    # The world is turned so that its z points where the model's -y did; views stay as they were.
    turned = torch.stack([before.points[:, 0], before.points[:, 2], -before.points[:, 1]], 1)
    assert torch.allclose(after.points, turned, atol=1e-6)
    for one, other in zip(before.frames, after.frames, strict=True):
        seen = before.points @ one.world_to_camera[:3, :3].T + one.world_to_camera[:3, 3]
        again = after.points @ other.world_to_camera[:3, :3].T + other.world_to_camera[:3, 3]
        assert torch.allclose(seen, again, atol=1e-6)
        assert other.lens.matrix().tolist() == one.lens.matrix().tolist()


def test_the_model_takes_the_place_of_a_transforms_file(tmp_path):
    taken, estimated = photos(tmp_path / "photos"), estimate(lens("OPENCV"))
    found = write_data_set(estimated, taken, tmp_path / "out", OutputRule(), layout="transforms")
    assert "photos have no times: methods for moving scenes need frames of videos" in found.notes[0]
    assert TransformsConfig().build(request(tmp_path / "out")).scene.num_times == 0
    write_data_set(estimated, taken, tmp_path / "out", OutputRule())
    assert not (tmp_path / "out/transforms.json").exists()
    assert not (tmp_path / "out/points.ply").exists()
    assert len(frames(loaded(tmp_path / "out"))) == VIEWS


@pytest.mark.parametrize(
    ("layout", "groups", "times", "note"),
    [
        (
            "colmap",
            ("", "", "", ""),
            (0.0, 1.0, 2.0, 3.0),
            "if the scene moves, layout=transforms keeps",
        ),
        (
            "transforms",
            ("a", "a", "b", "b"),
            (0.0, 1.0, 0.0, 1.0),
            "the times of 2 videos are seconds",
        ),
        (
            "transforms",
            ("a", "a", "", ""),
            (0.0, 1.0, None, None),
            "videos beside them lose theirs",
        ),
    ],
)
def test_notes_say_what_becomes_of_times(layout, groups, times, note, tmp_path):
    taken = [
        replace(one, group=group, time=time)
        for one, group, time in zip(photos(tmp_path / "p").images, groups, times, strict=True)
    ]
    images = ImageSet(tuple(taken))
    model = estimate(lens("OPENCV"))
    found = write_data_set(model, images, tmp_path / "out", OutputRule(), layout=layout)
    assert len(found.notes) == 1
    assert note in found.notes[0]
