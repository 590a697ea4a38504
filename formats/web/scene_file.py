"""Scene file of the player: splats at all times, quantised, the most important ones first.

A gzip stream of: the magic ``gsws``, the length of a JSON header (uint32), the header, and blocks
of ``BLOCK`` rows (the last one of fewer). All numbers are little-endian. The values of a block are
stored plane by plane, one byte of each row after the other, so that gzip finds what neighbours have
in common:

====================  =======  ===================================================================
mean                  9 bytes  float24 for each axis, relative to the header's ``origin``
opacity               1        round(255 opacity)
colour                3        (0.5 + C0 f_dc - color_low) / color_step
scale                 3        (log scale - scale_low) / scale_step
rotation              4        uint32, smallest three: bits 31 and 30 the index of the largest of
                               wxyz, then the others in order in 10 bits: 511 (1 + sqrt(2) q)
SH                    3 k      int8 by coefficient and channel: f_rest / sh_step; k = 0, 3, 8, ...
motion                60       float24: the fields of ``Motion``; only if the header's ``moving``
====================  =======  ===================================================================

float24 is float32 without its lowest byte: it has a relative error of 2^-16 at most, which no
splat far away makes coarser, as it would the steps of fixed-point numbers. Blocks hold the rows by
importance, so that a file is a coarser scene wherever it is cut; in a block they follow the Morton
curve.
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Int, UInt8
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import MotionFile, SplatFile
from gsfw.core.maths.spherical_harmonics import C0, num_coefficients
from gsfw.core.splats import Sh
from gsfw.formats.morton_order import morton_order
from gsfw.formats.smallest_three import BOUND, signs_in_smallest_three, smallest_three
from gsfw.formats.stored_rows import StoredRows, stored_parts
from gsfw.formats.web.shown import Shown

MAGIC = b"gsws"
VERSION = 1
BLOCK = 1 << 15
"""Rows of a block; the player shows the scene after each one."""
LEVELS = 255
"""Steps of a value of one byte."""
ROTATION_STEPS = 511
"""Steps of a component of a rotation on each side of 0."""
SH_STEP = 1 / 64
"""Least step of SH coefficients. A colour at degree 3 gets an error of 0.005 from it."""
MAX_SH = 127
SCALE_SPAN = 16.0
"""Most e-folds between the smallest and the largest scale: beyond, splats are points anyway."""
COLORS = (-1.0, 2.0)
"""Constant colours beyond these are clamped; bands above may bring any of them into [0, 1]."""
PRESENCE = (-1.0, 2.0)
"""Begin and end of splats that are always present: times outside of [0, 1]."""


@dataclass(frozen=True)
class Steps:
    """The steps that the values of one file are rounded to."""

    color_low: float
    color_step: float
    scale_low: float
    """Natural logarithm of the smallest scale."""
    scale_step: float
    sh_step: float

    @staticmethod
    def of(content: SplatFile, degree: int) -> Steps:
        """The finest steps that hold all values.

        Raises:
            ValueError: the splats are no quats-and-scales form with SH colours.
        """
        splats = content.splats
        if not isinstance(splats.colors, Sh) or splats.scales is None:
            raise ValueError("files hold splats in quats-and-scales form with SH colours")
        coefficients = splats.colors.dense()
        colors = (0.5 + C0 * coefficients[:, 0]).clamp(*COLORS)
        rest = coefficients[:, 1 : num_coefficients(degree)]
        largest = max(float(rest.max()), -float(rest.min())) if rest.numel() else 0.0
        low, high = float(colors.min()), float(colors.max())
        high_scale = float(splats.scales.max().clamp_min(1e-30).log())
        low_scale = max(float(splats.scales.min().clamp_min(1e-30).log()), high_scale - SCALE_SPAN)
        return Steps(
            color_low=low,
            color_step=max(high - low, 1e-6) / LEVELS,
            scale_low=low_scale,
            scale_step=max(high_scale - low_scale, 1e-6) / LEVELS,
            sh_step=max(SH_STEP, largest / MAX_SH),
        )


def scene_file(shown: Shown) -> Iterator[bytes]:
    """The whole file, in pieces.

    Raises:
        ValueError: a value is not finite, or out of range; names the field and the row.
    """
    _check(shown.content)
    return _compressed(_parts(shown))


def _check(content: MotionFile) -> None:
    """Refuse values that no file can hold, before the steps and the order are made of them.

    Raises:
        ValueError: a value is not finite, or out of range; names the field and the row.
    """
    splats = content.content.splats
    every = torch.arange(len(splats)).split(BLOCK)
    for part, rows in zip(stored_parts(splats, chunk=BLOCK), every, strict=True):
        finite = np.isfinite(_motion_columns(content, rows, part.quats)).all(axis=1)
        if not finite.all():
            first = int(rows[int((~finite).argmax())])
            raise ValueError(
                f"motion: row {first} is not finite ({int((~finite).sum())} such rows)"
            )


def _compressed(parts: Iterable[bytes]) -> Iterator[bytes]:
    """A gzip stream without name and date."""
    packer = zlib.compressobj(9, zlib.DEFLATED, wbits=31)
    for part in parts:
        if packed := packer.compress(part):
            yield packed
    yield packer.flush()


def _parts(shown: Shown) -> Iterator[bytes]:
    """The header, then the blocks, before compression."""
    content, splats = shown.content, shown.content.content.splats
    degree = min(shown.sh_degree, splats.sh_degree)
    steps = Steps.of(content.content, degree)
    origin = splats.means.double().median(dim=0).values.numpy()
    header = json.dumps(_header(shown, degree, steps, origin), allow_nan=False).encode()
    yield MAGIC + struct.pack("<I", len(header)) + header
    order = importance_order(content)
    parts = stored_parts(splats, order, BLOCK)
    for part, rows in zip(parts, order.split(BLOCK), strict=True):
        yield _block(part, degree, steps, origin)
        if not content.is_still:
            yield _planes(_motion_columns(content, rows, part.quats))


def importance_order(content: MotionFile) -> Int[Tensor, " n"]:
    """Rows by what they add to images, blocks of ``BLOCK`` in Morton order each.

    That is opacity times the largest scale, for as long as a splat is there. Of fox, half of the
    rows in this order are 29.2 dB from all of them; by opacity times area 27.2, by opacity 25.5, at
    random 23.7 dB.
    """
    splats, motion = content.content.splats, content.motion
    assert splats.scales is not None
    there = motion.end.clamp(0, 1) - motion.begin.clamp(0, 1)
    value = splats.opacities.double() * splats.scales.double().amax(dim=1)
    value = value * there * motion.width.clamp(max=1.0)
    order = value.argsort(descending=True, stable=True)
    return torch.cat([rows[morton_order(splats.means[rows])] for rows in order.split(BLOCK)])


def _header(
    shown: Shown, degree: int, steps: Steps, origin: Float[np.ndarray, " 3"]
) -> dict[str, Any]:
    """The header: plain data by name."""
    content, preview = shown.content, shown.preview
    splats = content.content.splats
    offsets = (splats.means.double() - torch.from_numpy(origin)).norm(dim=1)
    return {
        "version": VERSION,
        "rows": len(splats),
        "block": BLOCK,
        "degree": degree,
        "moving": not content.is_still,
        "antialiased": content.content.antialiased,
        "origin": origin.tolist(),
        "radius": float(offsets.median()),
        "up": content.content.up,
        "metre": shown.metre,
        "time_range": content.time_range,
        "frames": content.frames,
        "background": shown.background,
        "target": preview.target.tolist() if preview else None,
        "views": _views(preview.views) if preview else [],
        **asdict(steps),
    }


def _views(cameras: Cameras) -> list[dict[str, Any]]:
    """Cameras as plain data."""
    return [
        {
            "world_to_camera": pose.double().tolist(),
            "lens": [float(lens[0, 0]), float(lens[1, 1]), float(lens[0, 2]), float(lens[1, 2])],
            "size": [cameras.width, cameras.height],
        }
        for pose, lens in zip(cameras.world_to_camera, cameras.intrinsics, strict=True)
    ]


def _block(part: StoredRows, degree: int, steps: Steps, origin: Float[np.ndarray, " 3"]) -> bytes:
    """The planes of some rows, without their motion."""
    colors = (0.5 + C0 * part.dc - steps.color_low) / steps.color_step
    scales = (part.log_scales - steps.scale_low) / steps.scale_step
    count = num_coefficients(degree) - 1
    rest = np.rint(part.rest[:, :count].reshape(len(part), 3 * count) / steps.sh_step)
    return b"".join(
        [
            _planes((part.means - origin).astype(np.float32)),
            _bytes(part.opacities * LEVELS).tobytes(),
            _bytes(colors).T.tobytes(),
            _bytes(scales).T.tobytes(),
            _rotations(part.quats),
            rest.astype(np.int8).T.tobytes(),
        ]
    )


def _bytes(values: Float[np.ndarray, "*b"]) -> UInt8[np.ndarray, "*b"]:
    """The nearest of the steps 0 to 255."""
    return np.rint(values).clip(0, LEVELS).astype(np.uint8)


def _rotations(quats: Float32[np.ndarray, "n 4"]) -> bytes:
    """Smallest three in 32 bits, byte by byte."""
    largest, three = smallest_three(quats)
    steps = np.rint((three / BOUND + 1) * ROTATION_STEPS).clip(0, 2 * ROTATION_STEPS)
    first, second, third = steps.astype(np.uint32).T
    words = (largest.astype(np.uint32) << 30) | (first << 20) | (second << 10) | third
    return words.astype("<u4").view(np.uint8).reshape(-1, 4).T.tobytes()


def _planes(values: Float32[np.ndarray, "n c"]) -> bytes:
    """Numbers as float24: the planes of the highest bytes, of the middle ones, of the lowest."""
    bits = np.ascontiguousarray(values, dtype="<f4").view("<u4")
    upper = ((bits.astype(np.uint64) + 0x80) >> 8).astype("<u4")
    octets = upper.view(np.uint8).reshape(*upper.shape, 4)
    return octets[:, :, 2::-1].transpose(2, 1, 0).tobytes()


def _motion_columns(
    content: MotionFile, rows: Int[Tensor, " r"], quats: Float32[np.ndarray, "r 4"]
) -> Float32[np.ndarray, "r 20"]:
    """The motion of some rows, whose rotations are stored from ``quats``.

    Without the infinities, which shaders do not know.
    """
    motion = content.motion
    # The same sign as the rotations, whose largest component is positive in the file.
    signs = torch.from_numpy(signs_in_smallest_three(quats))[:, None]
    columns = [
        motion.center[rows, None],
        1 / motion.width[rows, None],
        motion.begin[rows, None].clamp(*PRESENCE),
        motion.end[rows, None].clamp(*PRESENCE),
        motion.path[rows].flatten(1),
        motion.spin[rows] * signs,
        motion.growth[rows],
    ]
    return torch.cat(columns, dim=1).float().numpy()
