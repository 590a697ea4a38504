"""Images of videos in any order."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from support.small_captures import HEIGHT, WIDTH
from support.small_videos import write_video

from gsfw.core.errors import DataError
from gsfw.datamanagers.images import DecodedImage
from gsfw.datamanagers.video import Shot, Video
from gsfw.datamanagers.video_images import FOLDERS, VideoImages

pytest.importorskip("av", reason="PyAV, which decodes videos, is not installed")

SIZE = WIDTH * HEIGHT * 3


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """A folder of its own for temporary files."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def images(tmp_path, room=None, masked=False, stride=1):
    """Those of two videos, which are numbered through, and what ``finish`` was called for."""
    videos = [Video.read(write_video(tmp_path / f"{name}.mp4")) for name in "ab"]
    shots = [Shot(video, number) for video in videos for number in range(0, 10, stride)]
    finished = []

    def finish(index, pixels):
        finished.append(index)
        mask = np.arange(HEIGHT * WIDTH).reshape(HEIGHT, WIDTH) % 3 > 0 if masked else None
        return DecodedImage(255 - pixels, mask)

    sizes = dict.fromkeys(range(len(shots)), SIZE)
    return VideoImages(dict(enumerate(shots)), sizes, finish, room), shots, finished


def wait_for(condition):
    """Until the threads have come so far; they need milliseconds."""
    for _ in range(1000):
        if condition():
            return
        time.sleep(0.01)
    raise TimeoutError


def test_images_are_the_same_first_and_later(temporary, tmp_path):
    held, shots, finished = images(tmp_path)
    order = [13, 2, 19, 7, 0, 11, 9, 15]
    first = [held.get(index).pixels for index in order]
    wait_for(lambda: len(held._kept) == 20)
    count = len(finished)
    for index, pixels in zip(order, first, strict=True):
        expected = 255 - shots[index].video.image(shots[index].number)
        assert np.array_equal(pixels, expected)
        assert np.array_equal(held.get(index).pixels, expected)
    assert len(finished) == count
    held.close()


def test_only_the_segments_that_were_asked_for_are_decoded(temporary, tmp_path):
    held, _, finished = images(tmp_path)
    held.get(5)
    wait_for(lambda: held._kept == {4, 5, 6, 7})
    assert set(finished) == {4, 5, 6, 7}
    held.close()


def test_images_that_no_frame_shows_are_not_kept(temporary, tmp_path):
    held, _, finished = images(tmp_path, stride=3)
    for index in range(8):
        held.get(index)
    wait_for(lambda: len(held._kept) == 8)
    assert set(finished) == set(range(8))
    held.close()


def test_masks_are_kept_too(temporary, tmp_path):
    held, _, _ = images(tmp_path, masked=True)
    mask = held.get(1).mask
    wait_for(lambda: 1 in held._kept)
    assert np.array_equal(held.get(1).mask, mask)
    held.close()


def test_what_has_no_room_is_decoded_again(temporary, tmp_path):
    held, shots, _ = images(tmp_path, room=3 * SIZE)
    for _ in range(2):
        for index in (9, 1, 15, 4):
            assert np.array_equal(
                held.get(index).pixels, 255 - shots[index].video.image(shots[index].number)
            )
    assert len(held._kept) <= 3
    assert held.notes() == (
        f"20 images of 2 videos: 0 MB once decoded, and 0 MB to use in {temporary}; the others "
        "are decoded again for each use, which is slow (use a larger downscale, or name a folder "
        "with more room: TMPDIR=DIR)",
    )
    held.close()


def test_a_full_disk_is_no_error(temporary, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    held, _, _ = images(tmp_path)
    monkeypatch.setattr(np, "save", refuse)
    assert held.get(3).pixels.shape == (HEIGHT, WIDTH, 3)
    assert held.get(3).pixels.shape == (HEIGHT, WIDTH, 3)
    assert not held._kept
    held.close()


def test_what_fits_only_partly_leaves_nothing(temporary, tmp_path, monkeypatch):
    def half(file, array):
        file.write_bytes(array.tobytes()[:9])
        raise OSError(28, "No space left on device")

    held, _, _ = images(tmp_path, masked=True)
    monkeypatch.setattr(np, "save", half)
    assert held.get(3).pixels.shape == (HEIGHT, WIDTH, 3)
    wait_for(lambda: not list(temporary.glob("*/*")))
    held.close()


def test_a_place_that_cannot_be_written_is_no_error(temporary, tmp_path):
    held, _, _ = images(tmp_path)
    temporary.rmdir()
    assert held.get(3).pixels.shape == (HEIGHT, WIDTH, 3)
    assert held.get(3).pixels.shape == (HEIGHT, WIDTH, 3)
    held.close()


@pytest.mark.skipif(os.name == "nt", reason="Windows does not tell whether a process is at work")
def test_what_killed_processes_left_is_removed_and_nothing_else(temporary, tmp_path):
    ended = subprocess.Popen([sys.executable, "-S", "-c", ""])
    ended.wait()
    (temporary / f"{FOLDERS}{ended.pid}-abc").mkdir()
    (temporary / f"{FOLDERS}{ended.pid}-abc" / "1.npy").touch()
    others = {f"{FOLDERS}{os.getppid()}-x", f"{FOLDERS}x-x", f"gsfw-video-elsewhere-{ended.pid}-x"}
    for name in others:
        (temporary / name).mkdir()
    held, _, _ = images(tmp_path)
    held.get(3)
    found = {path.name for path in temporary.iterdir()} - others
    assert len(found) == 1
    assert found.pop().startswith(f"{FOLDERS}{os.getpid()}-")
    held.close()
    assert {path.name for path in temporary.iterdir()} == others


def test_closing_removes_the_folder_and_opening_again_works(temporary, tmp_path):
    held, _, _ = images(tmp_path)
    before = held.get(3).pixels
    assert len(list(Path(temporary).iterdir())) == 1
    held.close()
    held.close()
    assert not list(Path(temporary).iterdir())
    assert np.array_equal(held.get(3).pixels, before)
    held.close()


def test_notes_say_what_is_kept_where(temporary, tmp_path):
    held, _, _ = images(tmp_path)
    assert held.notes() == (
        f"20 images of 2 videos: decoded once and kept in {temporary} while training (0 MB)",
    )
    assert VideoImages({}, {}, lambda *_: DecodedImage(np.zeros((1, 1, 3), np.uint8))).notes() == ()


def test_a_damaged_segment_is_the_error_of_who_asks_for_it(temporary, tmp_path):
    held, shots, _ = images(tmp_path)
    path = shots[0].video.path
    path.write_bytes(path.read_bytes()[:600])
    with pytest.raises(DataError, match=r"a\.mp4"):
        held.get(6)
    assert held.get(12).pixels.shape == (HEIGHT, WIDTH, 3)
    held.close()
