"""The ``neural-3d-video`` format: poses_bounds.npy, and a video or folder of images per camera.

The layout of Li et al. 2022 (Neural 3D Video Synthesis from Multi-view Video); poses are those of
LLFF, see ``llff_poses``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.datamanagers.camera_sequence import CameraSequence, StandingCamera, find_sequences
from gsfw.datamanagers.frames import Recording, no_points
from gsfw.datamanagers.llff import FILE, read_rows, root_of, row_camera
from gsfw.datamanagers.multi_camera import MultiCameraConfig
from gsfw.datamanagers.point_file import Points, read_points

LOOKED_FOR = f"{FILE} with cam*.mp4, or with folders cam*"
POINT_FILES = (
    "points3D.ply",
    "points3d.ply",
    "points3D_downsample2.ply",
    "points3D_downsample.ply",
)
"""Files of points, as written by tools that prepare these recordings."""


@dataclass
class Neural3DVideoConfig(MultiCameraConfig):
    """Settings of the ``neural-3d-video`` format. By default the first camera is held out."""

    frames: int = 300
    """Number of used times; 0: all. Papers use 300."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with poses_bounds.npy and a video or folder for each camera."""
        folder = root_of(path)
        cameras = find_sequences(folder, "cam") if (folder / FILE).is_file() else {}
        if not cameras:
            return Detection(False, LOOKED_FOR)
        return Detection(True, LOOKED_FOR, f"{FILE} and {', '.join(cameras)}", priority=40)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the poses and the headers of videos and images."""
        folder = root_of(path)
        found = find_sequences(folder, "cam")
        table = read_rows(folder / FILE)
        if len(found) != len(table):
            raise DataError(
                f"{folder / FILE} has {len(table)} cameras, but there are {len(found)} videos or "
                f"folders of images: {', '.join(found) or 'none'}.",
                "Expected one for each row, in the order of their names (cam00, cam01, ...).",
            )
        cameras = [
            StandingCamera(
                *row_camera(row, f"{folder / FILE}: row {number} ({name})"),
                CameraSequence.read(name, path),
            )
            for number, (row, (name, path)) in enumerate(zip(table, found.items(), strict=True))
        ]
        notes = [f"{folder / FILE}: {len(cameras)} cameras"]
        return self.recording_of(cameras, folder, notes, 1, _points(folder))


def _points(folder: Path) -> tuple[Points, str]:
    """The points beside the poses, and a note on them."""
    file = next((folder / name for name in POINT_FILES if (folder / name).is_file()), None)
    if file is None:
        return no_points(), f"there are no points (looked for {', '.join(POINT_FILES)})"
    points = read_points(file, "it")
    return points, f"{file}: {len(points[0])} points"
