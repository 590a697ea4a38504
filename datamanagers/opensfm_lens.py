"""Lenses of OpenSfM's reconstruction.json: its projection types as COLMAP's models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from gsfw.core.errors import DataError
from gsfw.datamanagers.brown import brown_lens, fisheye_lens
from gsfw.datamanagers.json_file import mapping, number
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.pictures import Header

BROWN = ("perspective", "brown", "radial", "simple_radial")
FISHEYE = ("fisheye", "fisheye_opencv")
LONG_FISHEYE = ("fisheye62", "fisheye624")
"""Fisheyes with six radial terms, and tangential ones that no model of COLMAP has like this."""
FURTHER = ("p1", "p2", "s0", "s1", "s2", "s3")


def read_lens(entry: Any, header: Header, where: str) -> Lens:  # noqa: ANN401
    """The lens of a camera, in pixels of the size that the file says; else of the picture's.

    Raises:
        DataError: it is of a kind that cannot be used, or its numbers are not those of a camera.
    """
    camera = mapping(entry, where)
    kind = camera.get("projection_type", "perspective")
    if kind not in (*BROWN, *FISHEYE, *LONG_FISHEYE):
        raise DataError(
            f"{where}: pictures of {kind} cameras cannot be trained on.",
            f"Expected one of {', '.join((*BROWN, *FISHEYE, *LONG_FISHEYE))}.",
        )
    pinhole = _pinhole(camera, header, where)
    k1, k2, k3, k4, k5, k6 = (number(camera, f"k{i}", where, 0.0) for i in range(1, 7))
    further = [number(camera, key, where, 0.0) for key in FURTHER]
    if kind in BROWN:
        return brown_lens(pinhole, (k1, k2, k3, 0.0), (further[0], further[1]))
    if kind in FISHEYE:
        return fisheye_lens(pinhole, (k1, k2, k3, k4), (0.0, 0.0))
    if any(further):
        raise DataError(
            f"{where}: the tangential and thin prism terms of {kind} cannot be used.",
            "Estimate the cameras as fisheye_opencv, or export undistorted pictures.",
        )
    distortion = (k1, k2, k3, k4, k5, k6, *(0.0,) * 6)
    return replace(pinhole, model="RAD_TAN_THIN_PRISM_FISHEYE", distortion=distortion)


def _pinhole(camera: Mapping[str, Any], header: Header, where: str) -> Lens:
    width = round(number(camera, "width", where, float(header.width)))
    height = round(number(camera, "height", where, float(header.height)))
    longer = max(width, height)
    if "focal" in camera:
        focal_x = focal_y = number(camera, "focal", where)
    else:
        focal_x = number(camera, "focal_x", where)
        focal_y = number(camera, "focal_y", where, focal_x)
    lens = Lens(
        fx=focal_x * longer,
        fy=focal_y * longer,
        cx=width / 2 + number(camera, "c_x", where, 0.0) * longer,
        cy=height / 2 + number(camera, "c_y", where, 0.0) * longer,
        width=width,
        height=height,
        source=where,
    )
    lens.check()
    return lens
