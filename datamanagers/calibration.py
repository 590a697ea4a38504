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

from gsfw.core.errors import DataError
from gsfw.core.files.json_text import parsed_json
from gsfw.core.files.toml_text import parsed_toml
from gsfw.core.maths.rotations import rotation_vector_matrices
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.poses import pose_from_center, pose_from_opencv
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
        cameras = [_opencv(name, entry, file) for name, entry in _entries(file).items()]
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
        raise DataError(
            f"{file} cannot be read: {error}", "Write the file again; it may have been cut off."
        ) from error
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


def _opencv(name: str, entry: Mapping[str, Any], file: Path) -> CalibratedCamera:
    """A camera with OpenCV's numbers."""
    where = f"camera {name} of {file}"
    matrix = _array(entry, MATRIX_KEYS, ((3, 3),), where)
    width, height = _size(entry, where)
    model, distortion = _distortion(entry, where)
    lens = Lens(
        fx=float(matrix[0, 0]),
        fy=float(matrix[1, 1]),
        cx=float(matrix[0, 2]) + HALF,
        cy=float(matrix[1, 2]) + HALF,
        width=width,
        height=height,
        source=where,
        model=model,
        distortion=distortion,
    )
    lens.check()
    return CalibratedCamera(name, lens, pose_from_opencv(_pose(entry, where), where))


def _size(entry: Mapping[str, Any], where: str) -> tuple[int, int]:
    for width, height in SIZE_KEYS:
        if width in entry and height in entry:
            entry = {"size": [entry[width], entry[height]]}
            break
    size = _array(entry, SIZE_LISTS, ((2,),), where)
    if not size.isfinite().all():
        raise DataError(f"{where}: its size is {size.tolist()}; expected 2 finite numbers.")
    return round(float(size[0])), round(float(size[1]))


def _distortion(entry: Mapping[str, Any], where: str) -> tuple[str, tuple[float, ...]]:
    """COLMAP's model and parameters, from OpenCV's k1, k2, p1, p2, k3, k4, k5, k6."""
    if not any(key in entry for key in DISTORTION_KEYS):
        return "PINHOLE", ()
    shapes = ((0,), (4,), (5,), (8,))
    found = tuple(_array(entry, DISTORTION_KEYS, shapes, where).tolist())
    if entry.get("fisheye") is True:
        return "OPENCV_FISHEYE", (*found, *[0.0] * (4 - len(found)))[:4]
    if not any(found):
        return "PINHOLE", ()
    if len(found) == 4:
        return "OPENCV", found
    return "FULL_OPENCV", (*found, *[0.0] * (8 - len(found)))


def _pose(entry: Mapping[str, Any], where: str) -> Float64[Tensor, "r 4"]:
    """World-to-camera: whole, or a rotation (matrix, or Rodrigues' vector) and a translation."""
    if any(key in entry for key in POSE_KEYS):
        return _array(entry, POSE_KEYS, ((3, 4), (4, 4)), where)
    rotation = _array(entry, ROTATION_KEYS, ((3, 3), (3,), (3, 1), (1, 3)), where)
    translation = _array(entry, TRANSLATION_KEYS, ((3,), (3, 1), (1, 3)), where)
    if rotation.numel() == 3:
        rotation = rotation_vector_matrices(rotation.view(1, 3))[0]
    return torch.cat([rotation, translation.reshape(3, 1)], dim=1)


def _array(
    entry: Mapping[str, Any], keys: tuple[str, ...], shapes: tuple[tuple[int, ...], ...], where: str
) -> Tensor:
    """The first of some settings that there is."""
    key = next((key for key in keys if key in entry), None)
    if key is None:
        raise DataError(f"{where} has no {keys[0]} (looked for {', '.join(keys)}).")
    try:
        numbers = torch.tensor(entry[key], dtype=torch.float64)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        numbers = torch.empty(0, 0, dtype=torch.float64)
    if tuple(numbers.shape) not in shapes:
        expected = " or ".join("x".join(map(str, shape)) for shape in shapes if shape != (0,))
        raise DataError(f"{where}: {key} is {entry[key]!r}; expected {expected} numbers.")
    return numbers


def _qualisys(file: Path) -> list[CalibratedCamera]:
    """The cameras of a Qualisys calibration (.qca.txt), in metres."""
    root = read_xml(file, "Export the calibration again.")
    return [_qualisys_camera(node, file) for node in root.iter("camera")]


def _qualisys_camera(node: Element, file: Path) -> CalibratedCamera:
    name = node.get("serial", "?")
    where = f"camera {name} of {file}"
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
