"""The ``synchronised-videos`` format: a calibration file, and a video of each camera beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.datamanagers.calibration import CalibratedCamera, read_calibration
from gsfw.datamanagers.camera_sequence import CameraSequence, StandingCamera, find_sequences
from gsfw.datamanagers.frames import Recording, no_points
from gsfw.datamanagers.multi_camera import MultiCameraConfig
from gsfw.datamanagers.point_file import Points, read_points
from gsfw.datamanagers.video import is_video

PATTERNS = ("cameras*.json", "*calib*.json", "*calib*.toml", "*.qca.txt")
"""Names of calibration files, in any case; where there are several, the first of them is read."""
LOOKED_FOR = f"{', '.join(PATTERNS[:-1])} or {PATTERNS[-1]} with videos there or in a folder there"
ENOUGH_TO_HOLD_OUT = 3
"""Fewest cameras of which one is held out: one alone does not show a shape."""


@dataclass
class SynchronisedVideosConfig(MultiCameraConfig):
    """Settings of the ``synchronised-videos`` format. By default the first camera is held out."""

    calibration: str = ""
    """Calibration file, relative to the data set. Empty: cameras*.json, *calib*.toml, *.qca.txt."""
    videos: str = ""
    """Folder of the videos, relative to the data set. Empty: the first that holds any."""
    points: str = ""
    """PLY file of points to start from, relative to the data set."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A calibration file with at least two videos beside it or in a folder beside it."""
        calibrations = _calibrations(path)
        folder = _video_folder(path) if calibrations else None
        if folder is None:
            return Detection(False, LOOKED_FOR)
        videos = ", ".join(item.name for item in find_sequences(folder).values())
        return Detection(True, LOOKED_FOR, f"{calibrations[0].name} and {videos}", priority=15)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the calibration and the headers of the videos."""
        file = self._calibration_file(path)
        cameras, left_out = self._cameras(read_calibration(file), path, file)
        notes = [f"{file}: {len(cameras)} cameras", *left_out]
        held_out = 1 if len(cameras) >= ENOUGH_TO_HOLD_OUT else 0
        return self.recording_of(cameras, path, notes, held_out, self._points(path))

    def _calibration_file(self, folder: Path) -> Path:
        if self.calibration:
            file = folder / self.calibration
            if not file.is_file():
                raise DataError(
                    f"datamanager.calibration={self.calibration}: there is no file {file}."
                )
            return file
        found = _calibrations(folder)
        if not found:
            raise DataError(
                f"{folder} contains no calibration file; looked for {', '.join(PATTERNS)}.",
                "Name it: datamanager.calibration=FILE.",
            )
        return found[0]

    def _cameras(
        self, calibrated: list[CalibratedCamera], folder: Path, file: Path
    ) -> tuple[list[StandingCamera], tuple[str, ...]]:
        """The cameras that have a video or images, and notes on what is left out."""
        where = folder / self.videos if self.videos else _video_folder(folder)
        found = find_sequences(where) if where is not None else {}
        known = {camera.name: camera for camera in calibrated}
        both = [name for name in known if name in found]
        if not both:
            raise DataError(
                f"no video or folder of images in {where or folder} has the name of a camera: "
                f"{file.name} has {', '.join(known)}, the videos are "
                f"{', '.join(path.name for path in found.values()) or 'none'}.",
                "Give videos the names of their cameras, or name their folder: "
                "datamanager.videos=DIR.",
            )
        notes = []
        for what, names in (
            ("without a video", [name for name in known if name not in found]),
            (f"not in {file.name}", [name for name in found if name not in known]),
        ):
            if names:
                notes.append(f"left out because {what}: {', '.join(names)}")
        cameras = [
            StandingCamera(
                known[name].lens,
                known[name].world_to_camera,
                CameraSequence.read(name, found[name]),
            )
            for name in both
        ]
        return cameras, tuple(notes)

    def _points(self, folder: Path) -> tuple[Points, str]:
        if not self.points:
            return no_points(), "there are no points (datamanager.points=FILE.ply names them)"
        points = read_points(folder / self.points, "datamanager.points")
        return points, f"{folder / self.points}: {len(points[0])} points"


def _calibrations(folder: Path) -> list[Path]:
    """Calibration files, by the order of the patterns, then by name."""
    if not folder.is_dir():
        return []
    files = sorted(item for item in folder.iterdir() if item.is_file())
    return [
        file for pattern in PATTERNS for file in files if Path(file.name.lower()).match(pattern)
    ]


def _video_folder(folder: Path) -> Path | None:
    """The first folder with at least two videos: ``folder`` itself, or one in it."""
    folders = [folder, *sorted(item for item in folder.iterdir() if item.is_dir())]
    return next((place for place in folders if _videos(place) > 1), None)


def _videos(folder: Path) -> int:
    return sum(is_video(item) for item in folder.iterdir())
