"""Reader of COLMAP's text models."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float64, UInt8

from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap.model import CAMERA_MODELS, ColmapCamera, ColmapImage, Tracks, damaged

PARAMETERS = dict(CAMERA_MODELS)
POINT_LAYOUT = "POINT3D_ID X Y Z R G B ERROR TRACK"
MOST_IMAGES = 2**32
"""Numbers of images are below, in COLMAP's binary files."""


def read_cameras(file: Path) -> dict[int, ColmapCamera]:
    """Cameras by their number.

    Raises:
        DataError: a line is not that of a camera.
    """
    cameras = {}
    for number, line in _lines(file):
        if _is_blank(line):
            continue
        try:
            identifier, model, width, height, *values = line.split()
            camera = ColmapCamera(model, int(width), int(height), tuple(map(float, values)))
            cameras[int(identifier)] = camera
        except ValueError:
            raise _unreadable(file, number, "CAMERA_ID MODEL WIDTH HEIGHT PARAMS", line) from None
        expected = PARAMETERS.get(model)
        if expected != len(values):
            what = f"line {number}: camera model {model} with {len(values)} parameters"
            raise damaged(file, f"{what} (expected {expected or 'a model that COLMAP knows'})")
    return cameras


def read_images(file: Path) -> list[ColmapImage]:
    """Registered images; each has a second line of observations, which may be empty.

    Raises:
        DataError: a line is not that of an image.
    """
    images = []
    lines = _lines(file)
    for number, line in lines:
        if _is_blank(line):
            continue
        try:
            identifier, *pose, camera, name = line.split(maxsplit=9)
            numbers = tuple(map(float, pose))
            quaternion, translation, identity = numbers[:4], numbers[4:], int(identifier)
            if len(numbers) != 7 or abs(identity) > MOST_IMAGES:
                raise ValueError
            images.append(ColmapImage(name.strip(), int(camera), quaternion, translation, identity))
        except ValueError:
            layout = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
            raise _unreadable(file, number, layout, line) from None
        _, observations = next(lines, (number + 1, ""))
        if len(observations.split()) % 3:
            layout = "X Y POINT3D_ID, repeated or left empty"
            raise _unreadable(file, number + 1, layout, observations)
    return images


def read_points(file: Path) -> tuple[Float64[np.ndarray, "p 3"], UInt8[np.ndarray, "p 3"]]:
    """Positions and colours of the points.

    Raises:
        DataError: a line is not that of a point.
    """
    points, colors = [], []
    for number, line in _lines(file):
        if _is_blank(line):
            continue
        try:
            _, x, y, z, red, green, blue, *_ = line.split(maxsplit=7)
            points.append((float(x), float(y), float(z)))
            colors.append([min(max(int(value), 0), 255) for value in (red, green, blue)])
        except ValueError:
            raise _unreadable(file, number, POINT_LAYOUT, line) from None
    return (
        np.array(points, np.float64).reshape(-1, 3),
        np.array(colors, np.uint8).reshape(-1, 3),
    )


def read_tracks(file: Path) -> Tracks:
    """The images that show each point, and the points' reprojection errors.

    Raises:
        DataError: a line is not that of a point.
    """
    images: list[int] = []
    lengths, errors = [], []
    for number, line in _lines(file):
        if _is_blank(line):
            continue
        try:
            error, *elements = line.split()[7:]
            errors.append(float(error))
            track = [int(image) for image in elements[::2]]
            if max(map(abs, track), default=0) > MOST_IMAGES:
                raise ValueError
        except ValueError:
            raise _unreadable(file, number, POINT_LAYOUT, line) from None
        images += track
        lengths.append(len(track))
    return Tracks(np.array(images, np.int64), np.array(lengths, np.int64), np.array(errors))


def _lines(file: Path) -> Iterator[tuple[int, str]]:
    return iter(enumerate(file.read_text("utf-8", "replace").splitlines(), 1))


def _is_blank(line: str) -> bool:
    return not line.strip() or line.startswith("#")


def _unreadable(file: Path, number: int, expected: str, line: str) -> DataError:
    found = line if len(line) <= 60 else f"{line[:60]}..."
    return damaged(file, f"line {number} should be {expected}; found {found!r}")
