"""splaTV: moving splats in the layout of the player of that name (antimatter15), 64 bytes each.

Its splats have the motion of Li et al. 2024 (see ``Motion``), for times in [0, 1]: a cubic path, a
quaternion that is linear in time, and a Gaussian window of opacity; constant scales; one colour for
all directions. Nearly all is stored in half floats, so that the loss is, relative to each value,
2^-11 at most; the temporal centre is rounded first, and the path is moved to the rounded one.

Layout: u32 magic, u32 length of a JSON text, which lists the parts that follow it; part "splat" is
a texture of four RGBA32UI texels for each splat, rows of 4096 texels, padded with zeros.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gsfw.core.color_bytes import color_bytes
from gsfw.core.errors import COPY_AGAIN, DataError
from gsfw.core.exchange import (
    Exporter,
    ExportSource,
    Holds,
    Importer,
    Motion,
    MotionFile,
    SplatFile,
)
from gsfw.core.files.atomic import atomic_file
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import parsed_json
from gsfw.core.files.reading import first_bytes, readable
from gsfw.core.maths.axes import known_or_usual_up, stated_axis
from gsfw.core.maths.camera_path import look_at
from gsfw.core.maths.rotations import unit_quaternions
from gsfw.core.maths.spherical_harmonics import dc_to_rgb, rgb_to_dc
from gsfw.core.motion.evaluation import recentered, splats_at
from gsfw.core.splats import Sh, Splats
from gsfw.formats.stored_rows import CHUNK, check_any

MAGIC = 0x674B
TEXELS = 4096
"""Texels of a row of the texture."""
TEXEL_BYTES, SPLAT_TEXELS = 16, 4
MAX_HEADER = 1 << 20
"""Longest JSON text that is read; the camera lists of players have some kilobytes."""
WIDEST = 65504.0
"""Largest half float: a window this wide is constant."""
NARROWEST = 2.0**-24
"""Smallest half float above 0."""
DISTANCE = 2.5
"""Distance of the first view from the middle, in standard deviations of the positions."""

RECORD = np.dtype(
    [
        ("means", "<f4", 3),
        ("quats", "<f2", 4),
        ("scales", "<f2", 3),
        ("unused", "<f2"),
        ("rgba", "u1", 4),
        ("path", "<f2", (3, 3)),
        ("unused_too", "<f2"),
        ("spin", "<f2", 4),
        ("center", "<f2"),
        ("width", "<f2"),
    ]
)
"""One splat: quaternions are wxyz, scales linear, paths [power, xyz], opacities rgba's last."""


class SplatvExporter(Exporter):
    """Writes moving splats, each in one piece; view dependence and growth are left out."""

    suffix = ".splatv"
    most_sh_degree = 0
    holds = Holds.MOTION

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically.

        Raises:
            OutputError: it cannot be written.
            ValueError: a value is not finite, or beyond half floats; names the field and the row.
        """
        file = source.motion_file(pieces=False)
        check_any(file.content.splats)
        count = len(file.content.splats)
        height = -(-SPLAT_TEXELS * count // TEXELS)
        size = height * TEXELS * TEXEL_BYTES
        header = json.dumps([_part(file, size, height)]).encode()
        with atomic_file(path) as out:
            out.write(np.array([MAGIC, len(header)], "<u4").tobytes() + header)
            for records in _records(file):
                out.write(records.tobytes())
            out.write(bytes(size - count * RECORD.itemsize))


def _part(file: MotionFile, size: int, height: int) -> dict[str, Any]:
    """The entry of the splats, with what a player does not need under "gsfw"."""
    first, last = file.time_range or (0.0, 0.0)
    return {
        "type": "splat",
        "size": size,
        "texwidth": TEXELS,
        "texheight": height,
        "cameras": [_camera(file.content)],
        "gsfw": {
            "still": file.is_still,
            "first_time": first,
            "last_time": last,
            "frames": file.frames,
            "up": file.content.up,
            "antialiased": file.content.antialiased,
        },
    }


def _camera(content: SplatFile) -> dict[str, Any]:
    """A camera that looks at the middle of the splats from the side."""
    sample = content.splats.means[:: len(content.splats) // 100_000 + 1]
    middle = sample.median(dim=0).values
    size = float((sample - middle).abs().median(dim=0).values.norm()) * 1.5
    up = known_or_usual_up(content.up)
    place = middle + DISTANCE * max(size, 1e-6) * (up.roll(1).abs() * -1.0 + 0.3 * up)
    pose = look_at(place[None], middle, up)[0]
    return {
        "id": 0,
        "img_name": "front",
        "width": 1280,
        "height": 720,
        "position": place.tolist(),
        "rotation": pose[:3, :3].T.tolist(),
        "fx": 1000.0,
        "fy": 1000.0,
    }


def _records(file: MotionFile) -> Iterator[np.ndarray]:
    """The records, part by part."""
    for rows in torch.arange(len(file.content.splats)).split(CHUNK):
        splats, motion = _at_half_centers(file.content.splats.take(rows), file.motion.take(rows))
        if not isinstance(splats.colors, Sh) or splats.quats is None or splats.scales is None:
            raise ValueError("files hold splats in quats-and-scales form with SH colours")
        rgb = dc_to_rgb(splats.colors.coefficients[:, 0].double())
        rgba = torch.cat([rgb, splats.opacities[:, None]], dim=1).nan_to_num(-1.0)
        if bool((rgba[:, 3] < 0).any() or not splats.colors.coefficients.isfinite().all()):
            raise ValueError("colors or opacities are not finite")
        records = np.zeros(len(rows), RECORD)
        records["rgba"] = color_bytes(rgba).numpy()
        records["width"] = motion.width.clamp(NARROWEST, WIDEST).numpy()
        for field, values in (
            ("means", splats.means),
            ("quats", unit_quaternions(splats.quats)),
            ("scales", splats.scales),
            ("path", motion.path),
            ("spin", motion.spin),
            ("center", motion.center),
        ):
            with np.errstate(over="ignore"):
                records[field] = values.numpy()
            _check_stored(field, records[field].reshape(len(rows), -1), values, rows)
        yield records


def _at_half_centers(splats: Splats, motion: Motion) -> tuple[Splats, Motion]:
    """The same motion about temporal centres that are half floats."""
    center = motion.center.half().double()
    shift = center - motion.center
    if splats.quats is None:
        return splats, motion
    path = recentered(torch.cat([splats.means[:, None], motion.path], dim=1), shift)
    quats = splats.quats + motion.spin * shift[:, None]
    norms = quats.norm(dim=1, keepdim=True).clamp_min(torch.finfo(torch.float64).tiny)
    return (
        replace(splats, means=path[:, 0], quats=quats / norms),
        replace(motion, center=center, path=path[:, 1:], spin=motion.spin / norms),
    )


def _check_stored(field: str, stored: np.ndarray, given: Tensor, rows: Tensor) -> None:
    """Refuse NaN, infinities, and overflows of half floats."""
    bad = (~np.isfinite(stored).all(axis=1)).nonzero()[0]
    if len(bad):
        values = ", ".join(f"{value:g}" for value in given[bad[0]].flatten().tolist())
        raise ValueError(
            f"{field}: row {int(rows[bad[0]])} is {values}, which splaTV's half floats cannot hold "
            f"(at most {WIDEST:g}; {len(bad)} such rows)"
        )


class SplatvImporter(Importer):
    """Reads moving splats; ``read`` gives those of the first time."""

    @classmethod
    def recognises(cls, path: Path) -> bool:
        """True if it begins with the magic number and a list."""
        start = first_bytes(path, 9)
        return start[:4] == MAGIC.to_bytes(4, "little") and start[8:] == b"["

    def read(self, path: Path) -> SplatFile:
        """Read the file: the splats at its first time.

        Raises:
            DataError: it is damaged or of another format; names the cause.
        """
        file = self.read_motion(path)
        splats = replace(splats_at(file, 0.0), rows=None)
        moves = "no" if file.is_still else "yes; these are its splats at the first time"
        return replace(file.content, splats=splats, properties={"moves": moves})

    def read_motion(self, path: Path) -> MotionFile:
        """Read the file: its splats at all times.

        Raises:
            DataError: it is damaged or of another format; names the cause.
        """
        header, start, count = _read_header(path)
        records = np.fromfile(path, RECORD, count=count, offset=start)
        used = records.view((np.uint64, RECORD.itemsize // 8)).any(axis=1)
        content, motion = _activated(path, records[used])
        about = header.values.get("gsfw")
        if not isinstance(about, dict):  # Another tool's.
            is_still = not bool(
                motion.path.any() or motion.spin.any() or motion.width.isfinite().any()
            )
            return MotionFile(content, motion, None if is_still else (0.0, 1.0))
        fields = JsonFields(path, "gsfw", about)
        times = float(fields.numbers("first_time")), float(fields.numbers("last_time"))
        stated = replace(
            content, up=stated_axis(fields.text("up")), antialiased=fields.flag("antialiased")
        )
        still = fields.flag("still")
        return MotionFile(stated, motion, None if still else times, fields.count("frames", 1))


def _read_header(path: Path) -> tuple[JsonFields, int, int]:
    """The entry of the splats, the first byte and the number of records, checked by the size."""
    with readable(path), path.open("rb") as file:
        magic, length = np.frombuffer(file.read(8).ljust(8, b"\0"), "<u4").tolist()
        text = file.read(min(length, MAX_HEADER))
        size = path.stat().st_size
    if magic != MAGIC:
        raise DataError(f"{path} is not a splaTV file: it does not begin with its magic number.")
    if length > MAX_HEADER or len(text) < length:
        raise DataError(f"{path} is a damaged splaTV file: its header does not end.", COPY_AGAIN)
    try:
        parts = parsed_json(text)
    except ValueError as error:
        raise DataError(
            f"{path} is a damaged splaTV file: its header is no JSON.", COPY_AGAIN
        ) from error
    if not isinstance(parts, list) or not all(isinstance(part, dict) for part in parts):
        raise DataError(f"{path}: expected a list of parts as its header.", COPY_AGAIN)
    start = 8 + length
    for index, part in enumerate(parts):
        fields = JsonFields(path, f"parts[{index}]", part)
        part_size = fields.count("size")
        if part.get("type") == "splat":
            return fields, start, _checked_count(path, fields, part_size, size - start)
        start += part_size
    raise DataError(f"{path} has no part of type 'splat'.", COPY_AGAIN)


def _checked_count(path: Path, fields: JsonFields, stated: int, left: int) -> int:
    """Number of records of a part of a stated size, of ``left`` bytes that remain."""
    texels = fields.count("texwidth", 1) * fields.count("texheight", 1)
    if stated != texels * TEXEL_BYTES or stated % RECORD.itemsize:
        raise DataError(
            f"{path}: its header announces {texels} texels, and {stated} bytes for them.",
            COPY_AGAIN,
        )
    if stated > left:
        raise DataError(
            f"{path} is cut short: its header announces {stated} bytes of splats, and "
            f"{max(left, 0)} follow.",
            COPY_AGAIN,
        )
    return stated // RECORD.itemsize


def _activated(path: Path, records: np.ndarray) -> tuple[SplatFile, Motion]:
    """The splats of records, without those that are not finite."""
    finite = ~np.isnan(records["width"])  # Infinite ones are constant.
    for name in ("means", "quats", "scales", "path", "spin", "center"):
        finite &= np.isfinite(records[name]).all(axis=tuple(range(1, records[name].ndim)))
    if not finite.any():
        cause = "none of its rows is finite" if len(records) else "it has no rows"
        raise DataError(f"{path} contains no splats: {cause}.", "Get the file again.")
    names = ("means", "quats", "scales", "path", "spin", "center", "width", "rgba")
    kept = {name: torch.from_numpy(records[name][finite].astype(np.float64)) for name in names}
    rgba, width = kept["rgba"] / 255, kept["width"].abs().clamp_min(NARROWEST)
    norms = kept["quats"].norm(dim=1, keepdim=True)
    splats = Splats(
        means=kept["means"],
        opacities=rgba[:, 3],
        colors=Sh(rgb_to_dc(rgba[:, :3])[:, None], 0),
        quats=unit_quaternions(kept["quats"]),
        scales=kept["scales"].abs(),
    )
    motion = replace(
        Motion.none(len(splats)),
        center=kept["center"],
        width=torch.where(width >= WIDEST, torch.inf, width),
        path=kept["path"],
        spin=torch.where(norms > 0, kept["spin"] / norms, 0.0),
    )
    dropped = len(records) - len(splats)
    return SplatFile(splats, num_dropped=dropped), motion
