"""The ``reality-capture`` format: CSV of RealityCapture's "Internal/External camera parameters".

Columns are named by the first line, "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,...,t1,t2" (or, by
RealityScan 2, yaw, f_35mm, px_norm and py_norm); those after f may be missing. Positions are in the
world, z up; angles are in degrees: heading clockwise from north (y), pitch 0 looks straight down
and 90 at the horizon. The camera-to-world rotation, for OpenGL axes, is Rz(-heading) Rx(pitch)
Ry(roll), as nerfstudio's importer has it. f is in millimetres on 36 mm, px and py are offsets from
the image's centre; the longer side of the image is 36 mm, and 1. The distortion is Brown's with
t1 on r^2 + 2 x^2, so that t1 is OpenCV's p2: RealityScan's own template in OpenCV's order
(calibration.xml) writes k1, k2, t2, t1, k3, k4.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.datamanagers.brown import brown_lens
from gsfw.datamanagers.frames import Frame, Recording, missing_images
from gsfw.datamanagers.image_folder import ImageFolder, ImageFolderConfig, only_file
from gsfw.datamanagers.images import Header, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.poses import pose_from_opengl

NEEDED = ("name", "x", "y", "alt", "heading", "pitch", "roll", "f")
OPTIONAL = ("px", "py", "k1", "k2", "k3", "k4", "t1", "t2")
NEW_NAMES = {"yaw": "heading", "f_35mm": "f", "px_norm": "px", "py_norm": "py"}
"""Column names of RealityScan 2."""
LOOKED_FOR = "a CSV of RealityCapture's internal/external camera parameters with its images"
FILM = 36.0
"""Millimetres of the longer side of a 35 mm image."""
HEAD_BYTES = 4096
"""Bytes of a file that are searched for RealityCapture's columns."""


@dataclass
class RealityCaptureConfig(ImageFolderConfig):
    """Settings of the ``reality-capture`` format."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with such a file, or the file itself; looks at the first lines of CSV files."""
        files = _files(path)
        if not files:
            return Detection(False, LOOKED_FOR)
        return Detection(True, LOOKED_FOR, f"RealityCapture's {files[0].name}", priority=22)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the file, its points and the headers of the images."""
        file = only_file(
            path,
            _files(path),
            "CSV whose first line is #name,x,y,alt,heading,pitch,roll,f,...",
            "Give the file itself (Alignment > Export > Registration > Internal/External "
            "camera parameters).",
        )
        root = file.absolute().parent
        images = self.image_folder(root)
        rows = list(_rows(file))
        if not rows:
            raise DataError(f"{file} contains no cameras.", "Export the registration again.")
        frames, missing = _frames(rows, images, file)
        (points, colors), point_note = self.start_points(root)
        return Recording(
            name=root.name,
            path=file,
            frames=tuple(frames),
            points=points,
            point_colors=colors,
            notes=(
                f"{file}: {len(rows)} cameras",
                *missing_images(missing, len(rows), images.path, has_setting=True),
                *point_note,
            ),
            up="z",
        )


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        found = (item for item in sorted(path.glob("*.[cC][sS][vV]")) if item.is_file())
        return [item for item in found if _columns(_head(item))]
    return [path] if path.suffix.lower() == ".csv" and _columns(_head(path)) else []


def _head(file: Path) -> list[str]:
    with file.open("rb") as stream:
        return stream.read(HEAD_BYTES).decode("utf-8-sig", "replace").splitlines()


def _columns(lines: list[str]) -> list[str]:
    """The names of the columns; none where this is another file.

    A line "#cameras N" may come first.
    """
    first = next((line for line in lines if line.strip() and "#cameras" not in line.lower()), "")
    names = [name.strip().lstrip("#").lower() for name in first.split(",")]
    names = [NEW_NAMES.get(name, name) for name in names]
    return names if set(NEEDED) <= set(names) else []


def _rows(file: Path) -> Iterator[tuple[int, Mapping[str, str]]]:
    """The cameras by column, each with the number of its line."""
    lines = file.read_bytes().decode("utf-8-sig", "replace").splitlines()
    columns = _columns(lines)
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            cells = next(csv.reader(io.StringIO(line)))
        except csv.Error as error:  # A NUL on Python 3.10, and a field of more than 128 KiB.
            raise DataError(
                f"{file}: line {number} is no CSV: {error}.", "Export the registration again."
            ) from error
        if columns[0] == cells[0].strip().lower():
            continue
        if len(cells) < len(columns):
            raise DataError(
                f"{file}: line {number} has {len(cells)} of {len(columns)} columns.",
                "Export the registration again; the file may have been cut off.",
            )
        yield number, dict(zip(columns, cells, strict=False))


def _frames(
    rows: list[tuple[int, Mapping[str, str]]], images: ImageFolder, file: Path
) -> tuple[list[Frame], list[str]]:
    """The frames whose images are on disk, and the names of those that are not."""
    frames, missing = [], []
    cameras: dict[Lens, int] = {}
    for number, row in rows:
        name = row["name"].strip()
        where = f"{file}: line {number} ({name})"
        image = images.find(name, where) if name else None
        if image is None:
            missing.append(name or f"(line {number})")
            continue
        header = read_header(image)
        values = {key: _number(row, key, where) for key in (*NEEDED[1:], *OPTIONAL)}
        lens = _lens(values, header, where)
        frame = Frame(images.name(image), image, header, lens, _pose(values, where))
        frames.append(replace(frame, camera=cameras.setdefault(lens, len(cameras))))
    return frames, missing


def _number(row: Mapping[str, str], key: str, where: str) -> float:
    text = row.get(key, "" if key in NEEDED else "0").strip()
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataError(
            f"{where}: {key} is {text!r}; expected a number.", "Export the registration again."
        )
    return value


def _lens(values: Mapping[str, float], header: Header, where: str) -> Lens:
    longer = max(header.width, header.height)
    focal = values["f"] / FILM * longer
    pinhole = Lens(
        fx=focal,
        fy=focal,
        cx=header.width / 2 + values["px"] * longer,
        cy=header.height / 2 + values["py"] * longer,
        width=header.width,
        height=header.height,
        source=where,
    )
    pinhole.check()
    radial = (values["k1"], values["k2"], values["k3"], values["k4"])
    return brown_lens(pinhole, radial, (values["t2"], values["t1"]))


def _pose(values: Mapping[str, float], where: str) -> Float64[Tensor, "4 4"]:
    heading, pitch, roll = (math.radians(values[key]) for key in ("heading", "pitch", "roll"))
    rotation = _turn(2, -heading) @ _turn(0, pitch) @ _turn(1, roll)
    position = torch.tensor([[values[key]] for key in ("x", "y", "alt")], dtype=torch.float64)
    return pose_from_opengl(torch.cat([rotation, position], dim=1), where)


def _turn(axis: int, angle: float) -> Float64[Tensor, "3 3"]:
    """The rotation about a coordinate axis, right-handed."""
    after, last = (axis + 1) % 3, (axis + 2) % 3
    matrix = torch.eye(3, dtype=torch.float64)
    matrix[after, after] = matrix[last, last] = math.cos(angle)
    matrix[last, after] = math.sin(angle)
    matrix[after, last] = -math.sin(angle)
    return matrix
