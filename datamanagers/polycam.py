"""The ``polycam`` format: the raw data that Polycam exports in developer mode.

keyframes/ holds images/ and cameras/, and corrected_images/ and corrected_cameras/ where Polycam
has optimised the poses. A camera's JSON has fx, fy, cx, cy, width and height in pixels, and the
first three rows of its camera-to-world matrix (t_00 to t_23) in ARKit's axes: x right, y up, z
back, metres, with the world's y up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.reading import is_file
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import (
    Frame,
    Recording,
    missing_images,
    no_points,
)
from gsfw.datamanagers.images import EXTENSIONS, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.poses import pose_from_opengl

LOOKED_FOR = "keyframes/ with images/ and cameras/ (Polycam's raw data)"
LENS_KEYS = ("fx", "fy", "cx", "cy", "width", "height")
POSE_KEYS = tuple(f"t_{row}{column}" for row in range(3) for column in range(4))


@dataclass
class PolycamConfig(CaptureConfig):
    """Settings of the ``polycam`` format."""

    corrected: bool = True
    """True if the poses that Polycam optimised are preferred, with the images that go with them.
    """
    min_blur_score: float = 0.0
    """Images that Polycam scores lower are left out; sharp ones have high scores."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with keyframes and their cameras."""
        cameras = _cameras(_keyframes(path), corrected=True)
        if not cameras.is_dir():
            return Detection(False, LOOKED_FOR)
        return Detection(True, LOOKED_FOR, f"Polycam's {cameras.relative_to(path)}/", priority=40)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the cameras and the headers of the images."""
        keyframes = _keyframes(path)
        folder = _cameras(keyframes, self.corrected)
        files = sorted(folder.glob("*.json")) if folder.is_dir() else []
        if not files:
            raise DataError(
                f"{path} contains no {LOOKED_FOR}.",
                "Export the capture from Polycam as raw data (developer mode).",
            )
        images = keyframes / folder.name.replace("cameras", "images")
        frames, missing, blurred = self._frames(files, images)
        if not frames and blurred:
            raise DataError(
                f"datamanager.min_blur_score={self.min_blur_score:g}: all {len(blurred)} images "
                "score lower.",
                "Lower datamanager.min_blur_score.",
            )
        root = keyframes.absolute().parent
        points, colors = no_points()
        low = f"{len(blurred)} images score below {self.min_blur_score:g} and are left out"
        return Recording(
            name=root.name,
            path=path,
            frames=tuple(frames),
            points=points,
            point_colors=colors,
            notes=(
                f"{folder}: {len(files)} cameras",
                *((low,) if blurred else ()),
                *missing_images(missing, len(files), images),
                *_unused(keyframes, self.maps),
            ),
            up="y",
            left_out=frozenset(blurred),
        )

    def _frames(self, files: list[Path], images: Path) -> tuple[list[Frame], list[str], list[str]]:
        """The frames, the names of missing images, and of those that are too blurred."""
        frames, missing, blurred = [], [], []
        cameras: dict[Lens, int] = {}
        for file in files:
            entry = JsonFields.read(file)
            if entry.number("blur_score", self.min_blur_score) < self.min_blur_score:
                blurred.append(file.stem)
                continue
            names = (images / f"{file.stem}{extension}" for extension in EXTENSIONS)
            image = next((name for name in names if is_file(name)), None)
            if image is None:
                missing.append(file.stem)
                continue
            values = [entry.number(key) for key in POSE_KEYS]
            lens = _lens(entry)
            pose = torch.tensor(values, dtype=torch.float64).reshape(3, 4)
            header = read_header(image)
            frame = Frame(image.name, image, header, lens, pose_from_opengl(pose, str(file)))
            frames.append(replace(frame, camera=cameras.setdefault(lens, len(cameras))))
        return frames, missing, blurred


def _lens(entry: JsonFields) -> Lens:
    fx, fy, cx, cy, width, height = (entry.number(key) for key in LENS_KEYS)
    lens = Lens(fx, fy, cx, cy, round(width), round(height), entry.at)
    lens.check()
    return lens


def _keyframes(path: Path) -> Path:
    return path if path.name == "keyframes" else path / "keyframes"


def _cameras(keyframes: Path, corrected: bool) -> Path:
    """The folder of the cameras; corrected ones count only with their images."""
    names = ("corrected_cameras", "corrected_images")
    if corrected and all((keyframes / name).is_dir() for name in names):
        return keyframes / names[0]
    return keyframes / "cameras"


def _unused(keyframes: Path, maps: tuple[str, ...]) -> tuple[str, ...]:
    """Notes on files that are not used."""
    items = (
        (keyframes / "depth", "keyframes/depth (datamanager.maps=depth:keyframes/depth loads it)"),
        (keyframes / "confidence", "keyframes/confidence"),
        (keyframes.parent / "mesh_info.json", "mesh_info.json (where Polycam's mesh lies)"),
    )
    found = [
        name
        for item, name in items
        if item.exists() and not any(f"keyframes/{item.name}" in text for text in maps)
    ]
    return (f"not used: {', '.join(found)}",) if found else ()
