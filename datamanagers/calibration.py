"""Calibration files of several fixed cameras: JSON or TOML with OpenCV's numbers, Qualisys XML.

OpenCV counts pixels from the centre of the first one, gsfw from its corner: principal points move
by half a pixel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import parsed_json
from gsfw.core.files.toml_text import parsed_toml
from gsfw.core.maths.rotations import rotation_vector_matrices
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.poses import pose_from_center, pose_from_opencv, read_rows
from gsfw.datamanagers.xml_file import read_xml

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

HALF = 0.5
"""From OpenCV's pixel coordinates to those where the first pixel's centre is at (0.5, 0.5)."""
SIZE_KEYS = (("w", "h"), ("width", "height"))
SIZE_LISTS = ("size", "image_size", "resolution")
MATRIX_KEYS = ("K", "matrix", "camera_matrix", "intrinsics", "intrinsic")
DISTORTION_KEYS = (
    *("distortions", "distortion", "dist", "dist_coeffs", "D"),
    *("distCoef", "dist_raw_k1k2p1p2"),
)
POSE_KEYS = ("w2c", "world_to_camera", "extrinsics", "extrinsic")
ROTATION_KEYS = ("rotation", "R", "rvec")
TRANSLATION_KEYS = ("translation", "t", "T", "tvec")
QUALISYS_SUBPIXELS = 64.0
"""Qualisys writes intrinsics in 64ths of a pixel (Qualisys Track Manager, calibration export)."""
MILLIMETRES = 1000.0
"""In a metre: Qualisys writes positions in millimetres."""


@dataclass(frozen=True)
class CalibratedCamera:
    """A camera of a calibration file."""

    name: str
    lens: Lens
    world_to_camera: Float64[Tensor, "4 4"]
    """Rigid, OpenCV axes, in the calibration's own world."""


def read_calibration(file: Path) -> list[CalibratedCamera]:
    """The cameras of a calibration file, sorted by name.

    Raises:
        DataError: it is damaged, or none of the layouts that are read.
    """
    if file.name.lower().endswith((".qca.txt", ".xml")):
        cameras = _qualisys(file)
    else:
        cameras = [
            _opencv(name, JsonFields.of(entry, file, f"camera {name}"))
            for name, entry in _entries(file).items()
        ]
    if not cameras:
        raise DataError(
            f"{file} contains no cameras.",
            'Expected {"cameras": [{"name", "w", "h", "K", "dist", "w2c"}, ...]}, OpenCV axes and '
            "pixels.",
        )
    return sorted(cameras, key=lambda camera: camera.name)


def _entries(file: Path) -> dict[str, Mapping[str, Any]]:
    """The settings of each camera: a list, or an object with the cameras' names as keys."""
    try:
        content = _parse(file)
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{file} cannot be read: {error}.", COPY_AGAIN) from error
    if isinstance(content, dict) and isinstance(content.get("cameras"), list | dict):
        content = content["cameras"]
    if isinstance(content, list):
        content = {
            str(entry.get("name", number)): entry
            for number, entry in enumerate(content)
            if isinstance(entry, dict)
        }
    if not isinstance(content, dict):
        return {}
    return {
        str(entry.get("name", name)): entry
        for name, entry in content.items()
        if isinstance(entry, dict) and name != "metadata"
    }


def _parse(file: Path) -> Any:  # noqa: ANN401 - whatever the file holds
    if file.suffix.lower() != ".toml":
        return parsed_json(file.read_text("utf-8-sig"))
    return parsed_toml(file.read_text("utf-8-sig"))


def _opencv(name: str, entry: JsonFields) -> CalibratedCamera:
    """A camera with OpenCV's numbers."""
    matrix = entry.numbers(entry.first(*MATRIX_KEYS), 3, 3)
    width, height = _size(entry)
    model, distortion = _distortion(entry)
    lens = Lens(
        fx=float(matrix[0, 0]),
        fy=float(matrix[1, 1]),
        cx=float(matrix[0, 2]) + HALF,
        cy=float(matrix[1, 2]) + HALF,
        width=width,
        height=height,
        source=entry.at,
        model=model,
        distortion=distortion,
    )
    lens.check()
    return CalibratedCamera(name, lens, pose_from_opencv(_pose(entry), entry.at))


def _size(entry: JsonFields) -> tuple[int, int]:
    for keys in SIZE_KEYS:
        if all(key in entry for key in keys):
            width, height = (entry.number(key) for key in keys)
            break
    else:
        width, height = entry.numbers(entry.first(*SIZE_LISTS), 2).tolist()
    return round(width), round(height)


def _distortion(entry: JsonFields) -> tuple[str, tuple[float, ...]]:
    """COLMAP's model and parameters, from OpenCV's k1, k2, p1, p2, k3, k4, k5, k6."""
    key = entry.first(*DISTORTION_KEYS)
    if key not in entry:
        return "PINHOLE", ()
    found = tuple(entry.numbers_of(key, ((0,), (4,), (5,), (8,))).tolist())
    if entry.values.get("fisheye") is True:
        return "OPENCV_FISHEYE", (*found, *[0.0] * (4 - len(found)))[:4]
    if not any(found):
        return "PINHOLE", ()
    if len(found) == 4:
        return "OPENCV", found
    return "FULL_OPENCV", (*found, *[0.0] * (8 - len(found)))


def _pose(entry: JsonFields) -> Float64[Tensor, "r 4"]:
    """World-to-camera: whole, or a rotation (matrix, or Rodrigues' vector) and a translation."""
    whole = entry.first(*POSE_KEYS)
    if whole in entry:
        return read_rows(entry, whole)
    vectors = ((3,), (3, 1), (1, 3))
    rotation, translation = (
        torch.from_numpy(entry.numbers_of(entry.first(*keys), shapes))
        for keys, shapes in ((ROTATION_KEYS, ((3, 3), *vectors)), (TRANSLATION_KEYS, vectors))
    )
    if rotation.numel() == 3:
        rotation = rotation_vector_matrices(rotation.view(1, 3))[0]
    return torch.cat([rotation, translation.reshape(3, 1)], dim=1)


def _qualisys(file: Path) -> list[CalibratedCamera]:
    """The cameras of a Qualisys calibration (.qca.txt), in metres."""
    root = read_xml(file, "Export the calibration again.")
    return [_qualisys_camera(node, file) for node in root.iter("camera")]


def _qualisys_camera(node: Element, file: Path) -> CalibratedCamera:
    name = node.get("serial", "?")
    where = f"{file}: camera {name}"
    _check_upright(node, where)
    view = _attributes(node, "fov_video", ("left", "top", "right", "bottom"), where)
    k = _attributes(
        node,
        "intrinsic",
        ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV"),
        where,
    )
    distortion = _attributes(
        node,
        "intrinsic",
        (
            *("radialDistortion1", "radialDistortion2"),
            *("tangentalDistortion1", "tangentalDistortion2"),
        ),
        where,
    )
    rows = [[f"r{row}{column}" for column in (1, 2, 3)] for row in (1, 2, 3)]
    rotation = torch.stack([_attributes(node, "transform", tuple(row), where) for row in rows])
    # Its cameras look along -z with y up.
    rotation = rotation * torch.tensor([[1.0], [-1.0], [-1.0]], dtype=torch.float64)
    center = _attributes(node, "transform", ("x", "y", "z"), where) / MILLIMETRES
    fx, fy, cx, cy = (k / QUALISYS_SUBPIXELS).tolist()
    left, top, right, bottom = view.tolist()
    lens = Lens(
        fx=fx,
        fy=fy,
        cx=cx - left + HALF,
        cy=cy - top + HALF,
        width=round(right - left) + 1,
        height=round(bottom - top) + 1,
        source=where,
        model="OPENCV",
        distortion=tuple(distortion.tolist()),
    )
    lens.check()
    return CalibratedCamera(name, lens, pose_from_center(rotation, center, where))


def _check_upright(node: Element, where: str) -> None:
    """Refuse a camera that was turned, which changes what its numbers mean."""
    try:
        turned = float(node.get("viewrotation", 0))
    except ValueError:
        raise DataError(
            f"{where}: viewrotation is {node.get('viewrotation')!r}; expected degrees.",
            "Export the calibration again.",
        ) from None
    if turned != 0:
        raise DataError(
            f"{where} is turned by {node.get('viewrotation')} degrees, which is not read.",
            "Convert the calibration to JSON with OpenCV's numbers.",
        )


def _attributes(
    node: Element, tag: str, names: tuple[str, ...], where: str
) -> Float64[Tensor, " n"]:
    """Numbers of the first child of this name."""
    child = node.find(tag)
    try:
        values = [float((child.attrib if child is not None else {})[name]) for name in names]
    except (KeyError, ValueError):
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise DataError(
            f"{where}: its {tag} lacks one of {', '.join(names)}.", "Export the calibration again."
        )
    return torch.tensor(values, dtype=torch.float64)
