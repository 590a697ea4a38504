"""Lenses of transforms*.json: camera_model and the coefficients that go with it.

The model is one of COLMAP's names, and OPENCV where the file does not say; see
https://docs.nerf.studio/quickstart/data_conventions.html.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gsfw.core.errors import DataError
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.json_file import optional_number
from gsfw.datamanagers.lens import COEFFICIENTS, Lens

FOCAL_KEYS = ("fl_x", "fl_y", "camera_angle_x", "camera_angle_y")
DISTORTION_KEYS = sorted({name for names in COEFFICIENTS.values() for name in names})
BROWN = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
"""Models that writers of these files choose among freely: the coefficients tell which it is."""
FISHEYE = ("SIMPLE_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
"""Models that are OPENCV_FISHEYE with fewer coefficients."""


def read_lens(
    settings: Mapping[str, Any], focal: Mapping[str, Any], header: Header, where: str, source: str
) -> Lens:
    """The lens of a frame.

    Args:
        settings: of the frame, and of the file where the frame does not have them.
        focal: the settings that focal lengths are taken from.
        header: of the frame's image.
        where: the frame, for messages.
        source: the file, for messages.

    Raises:
        DataError: there is no focal length, or the model and its coefficients contradict.
    """
    width = optional_number(settings, "w", where) or float(header.width)
    height = optional_number(settings, "h", where) or float(header.height)
    fx = _focal_length(focal, "x", width, where)
    fy = _focal_length(focal, "y", height, where)
    if fx is None and fy is None:
        raise DataError(
            f"{where}: there is no focal length.",
            f"Expected one of {', '.join(FOCAL_KEYS)}, for the file or for the frame.",
        )
    cx, cy = optional_number(settings, "cx", where), optional_number(settings, "cy", where)
    model, distortion = _distortion(settings, where)
    lens = Lens(
        fx=fx or fy or 0.0,
        fy=fy or fx or 0.0,
        cx=width / 2 if cx is None else cx,
        cy=height / 2 if cy is None else cy,
        width=round(width),
        height=round(height),
        source=source,
        model=model,
        distortion=distortion,
    )
    lens.check()
    return lens


def _focal_length(settings: Mapping[str, Any], axis: str, size: float, where: str) -> float | None:
    """In pixels, from itself or from the field of view (radians) over ``size`` pixels."""
    pixels = optional_number(settings, f"fl_{axis}", where)
    angle = optional_number(settings, f"camera_angle_{axis}", where)
    if pixels is not None or angle is None:
        return pixels
    if not 0 < angle < math.pi:
        raise DataError(
            f"{where}: camera_angle_{axis} is {angle:g}; expected radians between 0 and pi."
        )
    return 0.5 * size / math.tan(0.5 * angle)


def _distortion(settings: Mapping[str, Any], where: str) -> tuple[str, tuple[float, ...]]:
    """The model and its coefficients."""
    values = {key: optional_number(settings, key, where) or 0.0 for key in DISTORTION_KEYS}
    given = {key: value for key, value in values.items() if value}
    model = _model(settings, given, where)
    unused = sorted(given.keys() - set(COEFFICIENTS[model]))
    if unused:
        raise DataError(
            f"{where}: {', '.join(f'{key}={given[key]:g}' for key in unused)} has no meaning for "
            f"camera_model={model}, which has {', '.join(COEFFICIENTS[model]) or 'none'}.",
            "Remove it, or name the model it belongs to (FULL_OPENCV has k1 to k6, p1 and p2).",
        )
    return model, tuple(values[key] for key in COEFFICIENTS[model])


def _model(settings: Mapping[str, Any], given: Mapping[str, float], where: str) -> str:
    """COLMAP's name of the model."""
    named = settings.get("camera_model")
    named = "OPENCV" if named is None else named
    if not isinstance(named, str) or named not in COEFFICIENTS:
        raise DataError(
            f"{where}: cameras of camera_model={named} cannot be used.",
            f"Expected one of {', '.join(COEFFICIENTS)}.",
        )
    if settings.get("is_fisheye") is True and named in BROWN:
        return "OPENCV_FISHEYE"
    if named in FISHEYE:
        return "OPENCV_FISHEYE"
    if named not in BROWN:
        return named
    if "k5" in given or "k6" in given or ("k3" in given and "k4" not in given):
        return "FULL_OPENCV"
    # k4 alone may be nerfstudio's fourth radial term or OpenCV's first denominator.
    return "OPENCV" if given else "PINHOLE"
