"""Small scenes for the web player, and what their files hold."""

import json
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.exchange import ExportSource, Motion, MotionFile, Preview, SplatFile
from gsfw.core.maths.spherical_harmonics import C0, num_coefficients
from gsfw.core.splats import Sh, Splats
from gsfw.formats.smallest_three import BOUND, from_smallest_three

ORIGIN = torch.tensor([300.0, -20.0, 1000.0], dtype=torch.float64)
"""Middle of the scenes, far from the origin of their world, as in data with coordinates of maps."""


def ball(count: int = 2000, degree: int = 3) -> SplatFile:
    """Coloured splats in the shell of a ball of radius 1; z is up."""
    generator = torch.Generator().manual_seed(0)

    def rand(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    directions = torch.nn.functional.normalize(rand(count, 3) - 0.5, dim=1)
    coefficients = 0.4 * (rand(count, num_coefficients(degree), 3) - 0.5)
    coefficients[:, 0] = 1.6 * directions
    splats = Splats(
        means=ORIGIN + directions * (0.7 + 0.3 * rand(count, 1)),
        opacities=0.05 + 0.9 * rand(count),
        colors=Sh(coefficients.float(), degree),
        quats=torch.nn.functional.normalize(rand(count, 4) - 0.5, dim=1),
        scales=(0.015 + 0.06 * rand(count, 3)),
    )
    return SplatFile(splats, up="z")


def moving_ball(count: int = 1500) -> MotionFile:
    """The ball with every kind of motion: half of it in pieces that meet at the time 0.5."""
    generator = torch.Generator().manual_seed(0)

    def randn(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    half = torch.arange(count) % 2 == 0
    width = 0.2 + 0.5 * torch.rand(count, generator=generator, dtype=torch.float64)
    never = torch.full((count,), torch.inf, dtype=torch.float64)
    motion = Motion(
        center=torch.rand(count, generator=generator, dtype=torch.float64),
        width=torch.where(half, width, never),
        begin=torch.where(half, -never, torch.where(torch.arange(count) % 4 == 1, -never, 0.5)),
        end=torch.where(half, never, torch.where(torch.arange(count) % 4 == 1, 0.5, never)),
        path=torch.tensor([0.5, 0.4, 0.3], dtype=torch.float64)[:, None] * randn(count, 3, 3),
        spin=0.8 * randn(count, 4),
        growth=0.5 * randn(count, 3),
    )
    return MotionFile(ball(count, 1), motion, time_range=(2.0, 6.0), frames=31)


def at_time(content: MotionFile, time: float) -> Splats:
    """The splats at a time, by the formulas of ``Motion``."""
    splats, motion = content.content.splats, content.motion
    assert splats.quats is not None
    assert splats.scales is not None
    d = time - motion.center
    powers = torch.stack([d, d**2, d**3], dim=1)
    there = (time >= motion.begin) & (time < motion.end)
    return replace(
        splats,
        means=splats.means + torch.einsum("np,npx->nx", powers, motion.path),
        quats=torch.nn.functional.normalize(splats.quats, dim=1) + motion.spin * d[:, None],
        scales=splats.scales * (motion.growth * d[:, None]).exp(),
        opacities=splats.opacities * (-((d / motion.width) ** 2)).exp() * there,
    )


def cameras(count: int = 3, width: int = 320, height: int = 240) -> Cameras:
    """Cameras around the ball, at several heights; their principal points are off the middle."""
    angles = torch.arange(count, dtype=torch.float64) * 2.1 + 0.3
    around = torch.stack([angles.cos(), angles.sin(), 0.6 * (angles - 1).sin()], dim=1)
    found = Cameras.look_at(
        ORIGIN + 3.4 * around, ORIGIN, width=width, height=height, up=(0.0, 0.0, 1.0)
    )
    lenses = found.intrinsics.clone()
    lenses[:, 0, 2] += 11.5
    return replace(found, intrinsics=lenses)


@dataclass(frozen=True)
class WithPreview(ExportSource):
    """A file with a preview, as runs have it."""

    file: MotionFile
    first: Preview

    def motion_file(self) -> MotionFile:
        """The splats at all times."""
        return self.file

    def preview(self) -> Preview:
        """The first sight."""
        return self.first


@dataclass(frozen=True)
class SceneContent:
    """What a scene file holds, decoded as its description says."""

    header: Mapping[str, Any]
    splats: Splats
    motion: np.ndarray
    """[n, 20], or [n, 0]."""


def read_scene(content: bytes) -> SceneContent:
    """Decode a scene file."""
    data = zlib.decompress(content, wbits=31)
    assert data[:4] == b"gsws"
    (length,) = struct.unpack("<I", data[4:8])
    header = json.loads(data[8 : 8 + length])
    rest, blocks = data[8 + length :], []
    starts = [*range(0, header["rows"], header["block"]), header["rows"]]
    for first, last in pairwise(starts):
        columns, rest = _read_block(rest, last - first, header)
        blocks.append(columns)
    assert not rest
    means, alphas, colors, scales, quats, sh, motion = (
        np.concatenate(parts) for parts in zip(*blocks, strict=True)
    )
    dc = (header["color_low"] + header["color_step"] * colors - 0.5) / C0
    sh = header["sh_step"] * sh.reshape(len(sh), -1, 3)
    coefficients = np.concatenate([dc[:, None], sh], axis=1)
    return SceneContent(
        header,
        Splats(
            means=torch.from_numpy(means + np.array(header["origin"])),
            opacities=torch.from_numpy(alphas[:, 0] / 255),
            colors=Sh(torch.from_numpy(coefficients), header["degree"]),
            quats=torch.from_numpy(quats),
            scales=torch.from_numpy(np.exp(header["scale_low"] + header["scale_step"] * scales)),
        ),
        motion,
    )


def _read_block(data: bytes, count: int, header: Mapping[str, Any]) -> tuple[list, bytes]:
    """The columns of the first block, and the bytes after it."""
    widths = [9, 1, 3, 3, 4, 3 * (num_coefficients(header["degree"]) - 1), 60 * header["moving"]]
    planes = np.frombuffer(data, np.uint8, count * sum(widths)).reshape(-1, count).astype(np.int64)
    parts = np.split(planes, np.cumsum(widths)[:-1])
    means, alphas, colors, scales, octets, sh, motion = parts
    words = sum(octet << (8 * place) for place, octet in enumerate(octets))
    three = np.stack([(words >> shift) & 1023 for shift in (20, 10, 0)], axis=1)
    columns = [
        _floats(means), alphas.T, colors.T, scales.T,
        from_smallest_three(words >> 30, (three / 511 - 1) * BOUND),
        (sh.T ^ 128) - 128, _floats(motion),
    ]  # fmt: skip
    return columns, data[count * sum(widths) :]


def _floats(planes: np.ndarray) -> np.ndarray:
    """Columns of float24."""
    high, middle, low = planes.reshape(3, -1, planes.shape[1])
    bits = (high << 24) | (middle << 16) | (low << 8)
    return bits.T.astype(np.uint32).view(np.float32).astype(np.float64)
