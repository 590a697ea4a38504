"""The ``opensfm`` format: reconstruction.json of OpenSfM and OpenDroneMap.

Shots have a world-to-camera rotation (axis times angle, radians) and translation, OpenCV axes. The
world is metres to the east, north and up of reference_lla. Positions in an image are offsets from
its centre in parts of its longer side, and so are focal lengths and principal points
(opensfm.org/docs/geometry.html); distortion is that of OpenCV, in its order of p1 and p2
(opensfm/src/geometry/camera_distortions_functions.h).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import read_json
from gsfw.core.maths.rotations import rotation_vector_matrices
from gsfw.datamanagers.brown import brown_lens, fisheye_lens
from gsfw.datamanagers.frames import Frame, Recording, missing_images, no_points
from gsfw.datamanagers.image_folder import ImageFolder, ImageFolderConfig
from gsfw.datamanagers.images import Header, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.point_file import Points, check_points
from gsfw.datamanagers.poses import pose_from_opencv

BROWN = ("perspective", "brown", "radial", "simple_radial")
FISHEYE = ("fisheye", "fisheye_opencv")
LONG_FISHEYE = ("fisheye62", "fisheye624")
"""Fisheyes with six radial terms, and tangential ones that no model of COLMAP has like this."""
FURTHER = ("p1", "p2", "s0", "s1", "s2", "s3")


def read_lens(camera: JsonFields, header: Header) -> Lens:
    """The lens of a camera, in pixels of the size that the file says; else of the image's.

    Raises:
        DataError: it is of a kind that cannot be used, or its numbers are not those of a camera.
    """
    kind = camera.values.get("projection_type", "perspective")
    if kind not in (*BROWN, *FISHEYE, *LONG_FISHEYE):
        raise DataError(
            f"{camera.at}: images of {kind} cameras cannot be trained on.",
            f"Expected one of {', '.join((*BROWN, *FISHEYE, *LONG_FISHEYE))}.",
        )
    pinhole = _pinhole(camera, header)
    k1, k2, k3, k4, k5, k6 = (camera.number(f"k{i}", 0.0) for i in range(1, 7))
    further = [camera.number(key, 0.0) for key in FURTHER]
    if kind in BROWN:
        return brown_lens(pinhole, (k1, k2, k3, 0.0), (further[0], further[1]))
    if kind in FISHEYE:
        return fisheye_lens(pinhole, (k1, k2, k3, k4), (0.0, 0.0))
    if any(further):
        raise DataError(
            f"{camera.at}: the tangential and thin prism terms of {kind} cannot be used.",
            "Estimate the cameras as fisheye_opencv, or export undistorted images.",
        )
    distortion = (k1, k2, k3, k4, k5, k6, *(0.0,) * 6)
    return replace(pinhole, model="RAD_TAN_THIN_PRISM_FISHEYE", distortion=distortion)


def _pinhole(camera: JsonFields, header: Header) -> Lens:
    width = round(camera.number("width", float(header.width)))
    height = round(camera.number("height", float(header.height)))
    longer = max(width, height)
    if "focal" in camera:
        focal_x = focal_y = camera.number("focal")
    else:
        focal_x = camera.number("focal_x")
        focal_y = camera.number("focal_y", focal_x)
    lens = Lens(
        fx=focal_x * longer,
        fy=focal_y * longer,
        cx=width / 2 + camera.number("c_x", 0.0) * longer,
        cy=height / 2 + camera.number("c_y", 0.0) * longer,
        width=width,
        height=height,
        source=camera.at,
    )
    lens.check()
    return lens


FILE = "reconstruction.json"
LOOKED_FOR = f"{FILE} or opensfm/{FILE} with images/"


@dataclass
class OpenSfmConfig(ImageFolderConfig):
    """Settings of the ``opensfm`` format."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with a reconstruction.json, or such a file itself."""
        file = _file(path)
        if not file.is_file():
            return Detection(False, LOOKED_FOR)
        return Detection(True, LOOKED_FOR, file.name, priority=24)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the file and the headers of the images."""
        file = _file(path)
        if not file.is_file():
            raise DataError(
                f"{path} contains no {FILE}.", "Give the folder that contains it, or the file."
            )
        content, others = _largest(file)
        root = _root(file)
        images = self.image_folder(root)
        frames, missing = _frames(content, images)
        total = len(content.values["shots"])
        (points, colors), point_note = self.start_points(root, _points(content, file))
        return Recording(
            name=root.name,
            path=file,
            frames=tuple(frames),
            points=points,
            point_colors=colors,
            notes=(
                f"{file}: {total} shots, {len(points)} points",
                *others,
                *missing_images(missing, total, images.path, has_setting=True),
                *point_note,
                *_reference(content),
            ),
            up="z",
        )


def _file(path: Path) -> Path:
    if path.is_file():
        return path if path.name == FILE else path / FILE
    inner = path / "opensfm" / FILE
    return inner if inner.is_file() and not (path / FILE).is_file() else path / FILE


def _root(file: Path) -> Path:
    """The folder beside whose images/ the file belongs; OpenDroneMap puts it one level deeper."""
    folder = file.absolute().parent
    deeper = not (folder / "images").is_dir() and (folder.parent / "images").is_dir()
    return folder.parent if deeper else folder


def _largest(file: Path) -> tuple[JsonFields, tuple[str, ...]]:
    """The reconstruction with the most shots, and a note on the others."""
    content = read_json(file)
    if not isinstance(content, list) or not content:
        raise DataError(
            f"{file} is no list of reconstructions.",
            'Expected [{"cameras": ..., "shots": ..., "points": ...}].',
        )
    found = [JsonFields.of(entry, file, f"[{index}]") for index, entry in enumerate(content)]
    for entry in found:
        entry.fields("cameras")
    shots = [len(entry.fields("shots").values) for entry in found]
    best = found[shots.index(max(shots))]
    if not max(shots):
        raise DataError(f"{file} contains no shots: OpenSfM has placed no camera.")
    if len(content) == 1:
        return best, ()
    left_out = sum(shots) - max(shots)
    return best, (
        f"used the largest of {len(content)} reconstructions; {left_out} shots of the others are "
        "left out",
    )


def _frames(content: JsonFields, images: ImageFolder) -> tuple[list[Frame], list[str]]:
    """The frames whose images are on disk, and the names of those that are not."""
    cameras: dict[str, tuple[int, Lens]] = {}
    frames, missing = [], []
    known = content.values["cameras"]
    for name, entry in content.values["shots"].items():
        shot = JsonFields.of(entry, content.path, f"shot {name}")
        image = images.find(name, shot.at)
        if image is None:
            missing.append(name)
            continue
        header = read_header(image)
        key = str(shot.values.get("camera"))
        if key not in cameras:
            if key not in known:
                raise shot.refuse("camera", "a name in cameras")
            read = JsonFields.of(known[key], content.path, f"camera {key}")
            cameras[key] = len(cameras), read_lens(read, header)
        camera, lens = cameras[key]
        frame = images.frame(image, lens, _pose(shot), camera)
        if _same_shape(frame.lens, header.width, header.height):
            frame = replace(frame, lens=frame.lens.resized(header.width, header.height))
        frames.append(frame)
    return frames, missing


def _same_shape(lens: Lens, width: int, height: int) -> bool:
    """True if an image is that of a lens at another size, rounded to whole pixels."""
    scale = width / lens.width
    return abs(scale * lens.height - height) <= max(1.0, scale)


def _pose(shot: JsonFields) -> Float64[Tensor, "4 4"]:
    vector, translation = (
        torch.from_numpy(shot.numbers(name, 3)) for name in ("rotation", "translation")
    )
    matrix = torch.cat([rotation_vector_matrices(vector[None])[0], translation[:, None]], 1)
    return pose_from_opencv(matrix, shot.at)


def _points(content: JsonFields, file: Path) -> Points:
    if not content.values.get("points"):
        return no_points()
    entries = content.fields("points")
    points = [entries.fields(name) for name in entries.values]
    place = torch.from_numpy(np.stack([point.numbers("coordinates", 3) for point in points]))
    color = np.stack([point.numbers("color", 3, default=[128.0] * 3) for point in points])
    return check_points(place, torch.from_numpy(color / 255).clamp(0, 1).float(), file)


def _reference(content: JsonFields) -> tuple[str, ...]:
    reference = content.values.get("reference_lla")
    if not isinstance(reference, dict):
        return ()
    names = ("latitude", "longitude", "altitude")
    values = ", ".join(f"{name} {reference.get(name)}" for name in names)
    return (f"the world is metres to the east, north and up of {values}",)
