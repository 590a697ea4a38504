"""Lenses of transforms*.json: camera_model and the coefficients that go with it.

The model is one of COLMAP's names, and OPENCV where the file does not say; see
https://docs.nerf.studio/quickstart/data_conventions.html.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.lens import COEFFICIENTS, Lens

FOCAL_KEYS = ("fl_x", "fl_y", "camera_angle_x", "camera_angle_y")
DISTORTION_KEYS = sorted({name for names in COEFFICIENTS.values() for name in names})
BROWN = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV")
"""Models that writers of these files choose among freely: the coefficients tell which it is."""
FISHEYE = ("SIMPLE_FISHEYE", "FISHEYE", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE")
"""Models that are OPENCV_FISHEYE with fewer coefficients."""


def read_lens(settings: JsonFields, focal: JsonFields, header: Header, source: str) -> Lens:
    """The lens of a frame.

    Args:
        settings: of the frame, and of the file where the frame does not have them.
        focal: the settings that focal lengths are taken from.
        header: of the frame's image.
        source: the file, for messages.

    Raises:
        DataError: there is no focal length, or the model and its coefficients contradict.
    """
    width = settings.optional_number("w") or float(header.width)
    height = settings.optional_number("h") or float(header.height)
    fx = _focal_length(focal, "x", width)
    fy = _focal_length(focal, "y", height)
    if fx is None and fy is None:
        raise DataError(
            f"{settings.at}: there is no focal length.",
            f"Expected one of {', '.join(FOCAL_KEYS)}, for the file or for the frame.",
        )
    cx, cy = settings.optional_number("cx"), settings.optional_number("cy")
    model, distortion = _distortion(settings)
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


def _focal_length(settings: JsonFields, axis: str, size: float) -> float | None:
    """In pixels, from itself or from the field of view (radians) over ``size`` pixels."""
    pixels = settings.optional_number(f"fl_{axis}")
    angle = settings.optional_number(f"camera_angle_{axis}")
    if pixels is not None or angle is None:
        return pixels
    if not 0 < angle < math.pi:
        raise settings.refuse(f"camera_angle_{axis}", "radians between 0 and pi")
    return 0.5 * size / math.tan(0.5 * angle)


def _distortion(settings: JsonFields) -> tuple[str, tuple[float, ...]]:
    """The model and its coefficients."""
    values = {key: settings.optional_number(key) or 0.0 for key in DISTORTION_KEYS}
    given = {key: value for key, value in values.items() if value}
    model = _model(settings, given)
    unused = sorted(given.keys() - set(COEFFICIENTS[model]))
    if unused:
        shown = ", ".join(f"{key}={given[key]:g}" for key in unused)
        raise DataError(
            f"{settings.at}: {shown} has no meaning for camera_model={model}, which has "
            f"{', '.join(COEFFICIENTS[model]) or 'none'}.",
            "Remove it, or name the model it belongs to (FULL_OPENCV has k1 to k6, p1 and p2).",
        )
    return model, tuple(values[key] for key in COEFFICIENTS[model])


def _model(settings: JsonFields, given: Mapping[str, float]) -> str:
    """COLMAP's name of the model."""
    named = settings.values.get("camera_model")
    named = "OPENCV" if named is None else named
    if not isinstance(named, str) or named not in COEFFICIENTS:
        raise DataError(
            f"{settings.at}: cameras of camera_model={named} cannot be used.",
            f"Expected one of {', '.join(COEFFICIENTS)}.",
        )
    if settings.values.get("is_fisheye") is True and named in BROWN:
        return "OPENCV_FISHEYE"
    if named in FISHEYE:
        return "OPENCV_FISHEYE"
    if named not in BROWN:
        return named
    if "k5" in given or "k6" in given or ("k3" in given and "k4" not in given):
        return "FULL_OPENCV"
    # k4 alone may be nerfstudio's fourth radial term or OpenCV's first denominator.
    return "OPENCV" if given else "PINHOLE"
