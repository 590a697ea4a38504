"""Data sets that are written again, interrupted, or refused by the disk."""

import errno

import pytest
from support.distorted_images import lens
from support.estimated_cameras import (
    VIEWS,
    estimate,
    photos,
)
from support.watched_stages import WatchedStages

from gsfw.core.errors import OutputError
from gsfw.core.progress import shown_by
from gsfw.preparation.writing.data_set import write_data_set
from gsfw.preparation.writing.image_output import OutputRule


def test_nothing_of_an_earlier_estimate_stays(tmp_path):
    taken = photos(tmp_path / "photos")
    write_data_set(estimate(lens("OPENCV")), taken, tmp_path, OutputRule())
    before = (tmp_path / "images/view_0.png").read_bytes()
    fewer = estimate(lens("OPENCV", (-0.2, 0.05, 0.0, 0.0)))
    fewer.deregister_frame(fewer.images[2].frame_id)
    write_data_set(fewer, taken, tmp_path, OutputRule())
    assert (tmp_path / "images/view_0.png").read_bytes() != before
    assert not (tmp_path / "images/view_1.png").exists()


def test_an_interrupted_data_set_has_no_model_and_is_completed_later(tmp_path):
    taken, estimated = photos(tmp_path / "photos"), estimate(lens("OPENCV"))
    write_data_set(estimated, taken, tmp_path / "whole", OutputRule())
    out = tmp_path / "out"
    write_data_set(estimate(lens("SIMPLE_RADIAL")), taken, out, OutputRule())
    watched = WatchedStages(2)
    with pytest.raises(KeyboardInterrupt), shown_by(watched.show):
        write_data_set(estimated, taken, out, OutputRule())
    assert watched.stages == [("images", VIEWS)]
    assert not (out / "sparse/0/cameras.bin").exists()
    assert len(list((out / "images").iterdir())) == 2
    write_data_set(estimated, taken, out, OutputRule())
    for item in (tmp_path / "whole").rglob("*.*"):
        same = out / item.relative_to(tmp_path / "whole")
        assert same.read_bytes() == item.read_bytes()


def test_a_full_disk_is_said(tmp_path, monkeypatch):
    taken = photos(tmp_path / "photos")

    def full(handle):
        raise OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr("gsfw.core.files.atomic.os.fsync", full)
    with pytest.raises(OutputError) as error:
        write_data_set(estimate(lens("OPENCV")), taken, tmp_path / "out", OutputRule())
    assert str(error.value) == (
        f"the disk is full: {tmp_path}/out/work/written.txt could not be written.\n"
        "Free some space, or choose another place with out=DIR."
    )


def test_photos_are_never_written_over(tmp_path):
    taken = photos(tmp_path / "images")
    before = [one.path.read_bytes() for one in taken.images]
    with pytest.raises(OutputError, match=r"view_0.png is one of the images that are read"):
        write_data_set(estimate(lens("OPENCV")), taken, tmp_path, OutputRule())
    assert [one.path.read_bytes() for one in taken.images] == before
