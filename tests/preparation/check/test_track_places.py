"""Cameras that do not see what was matched in their images."""

import numpy as np
from support.small_captures import write_colmap
from support.tracked_ball import track_ball


def test_a_camera_that_does_not_see_its_points_is_misplaced(tmp_path):
    written = track_ball(tmp_path / "a")
    assert "cameras misplaced" not in written.findings(1)
    model = written.folder / "sparse" / "0"
    tracks = (model / "points3D.bin").read_bytes()
    turn = np.eye(4)
    turn[[0, 0, 2, 2], [0, 2, 0, 2]] = np.cos(0.7), np.sin(0.7), -np.sin(0.7), np.cos(0.7)
    written.capture.poses[5] = turn @ written.capture.poses[5]
    write_colmap(model, written.capture)
    (model / "points3D.bin").write_bytes(tracks)
    # One image is decoded, so that nothing is known but what the reconstruction says.
    found = written.findings(1)["cameras misplaced"]
    assert found.images == ("view_005.png",)
    assert "does not show the points that were matched in it" in found.found
