"""Which images show which points, as a COLMAP model says."""

import struct

import pytest
from support.small_captures import request, ring, write_colmap, write_images

from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap.config import ColmapConfig

TRACKS = [[3, 1], [], [2, 2, 1], [4]]
"""Numbers of images; the third point was matched twice in one image."""


def write_tracks(folder, suffix):
    """Four images, and points with the tracks above and errors of 0.5, 1.5, ..."""
    capture = ring(4)
    write_colmap(folder / "sparse" / "0", capture, suffix)
    write_images(folder / "images", capture)
    content, lines = struct.pack("<Q", len(TRACKS)), []
    for number, track in enumerate(TRACKS):
        error = number + 0.5
        content += struct.pack("<Q3d3BdQ", number, 0, 0, 0, 1, 2, 3, error, len(track))
        content += b"".join(struct.pack("<II", image, 7) for image in track)
        elements = " ".join(f"{image} 7" for image in track)
        lines.append(f"{number} 0 0 0 1 2 3 {error} {elements}")
    points = folder / "sparse" / "0" / f"points3D{suffix}"
    points.write_bytes(content if suffix == ".bin" else "\n".join(lines).encode())
    return points


def sightings(folder):
    """What is read, with the names of the images."""
    data = ColmapConfig().build(request(folder))
    data.close()
    found = data.recording.read_sightings()
    names = [data.recording.frames[frame].name for frame in found.frames]
    return list(zip(found.points.tolist(), names, strict=True)), found.errors


@pytest.mark.parametrize("suffix", [".bin", ".txt"])
def test_tracks_are_read_with_each_image_once(tmp_path, suffix):
    write_tracks(tmp_path, suffix)
    pairs, errors = sightings(tmp_path)
    names = ring(4).names
    assert pairs == [(0, names[0]), (0, names[2]), (2, names[0]), (2, names[1]), (3, names[3])]
    assert errors.tolist() == [0.5, 1.5, 2.5, 3.5]


def test_images_that_are_not_on_disk_show_nothing(tmp_path):
    write_tracks(tmp_path, ".bin")
    names = ring(4).names
    (tmp_path / "images" / names[0]).unlink()
    assert sightings(tmp_path)[0] == [(0, names[2]), (2, names[1]), (3, names[3])]


def test_a_model_without_points_has_no_sightings(tmp_path):
    write_tracks(tmp_path, ".bin").unlink()
    pairs, errors = sightings(tmp_path)
    assert pairs == []
    assert len(errors) == 0


def test_a_track_that_is_no_numbers_is_refused(tmp_path):
    points = write_tracks(tmp_path, ".txt")
    data = ColmapConfig().build(request(tmp_path))
    data.close()
    points.write_text("1 0 0 0 1 2 3 0.5 one 7")
    with pytest.raises(DataError) as error:
        data.recording.read_sightings()
    assert str(error.value).startswith(
        f"{points} is cut off or damaged: line 1 should be POINT3D_ID X Y Z R G B ERROR TRACK; "
        "found '1 0 0 0 1 2 3 0.5 one 7'"
    )
