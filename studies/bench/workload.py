"""Workload: splats and cameras to render, from a file or at random.

Random splats fill an image as those of a trained scene do.
"""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.files.array_file import array_names, read_array
from gsfw.core.input_checks import check_values
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE, num_coefficients
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats

Array = NDArray[np.float32]

FIELDS = (
    "means",
    "quats",
    "scales",
    "opacities",
    "colors",
    "world_to_camera",
    "intrinsics",
    "width",
    "height",
)
"""Arrays of a file; others are ignored."""

ADVICE = (
    "A workload is an npz file with means [n, 3], quats [n, 4] (wxyz), scales [n, 3] and "
    "opacities [n] after their activation, colors [n, 3] (RGB) or [n, k, 3] (SH), "
    "world_to_camera [4, 4] or [c, 4, 4], intrinsics [3, 3] or [c, 3, 3], width and height."
)

MAX_SIDE = 32_768
"""Largest side in pixels: a larger one is a mistake, which only a lack of memory would reveal."""

SPLATS, WIDTH, HEIGHT = 100_000, 640, 420
"""Number of splats and size of the image of the built-in workload."""
FOCAL = 0.75
"""In widths of the image."""
NEAREST, FURTHEST = 1.2, 3.2
"""View depths."""
SPREAD = 1.25
"""Reach of the splats, where the edges of the image are at 1: a third of them is unseen."""
SMALLEST_SCALE, LARGEST_SCALE = 1e-4, 0.02
"""Standard deviations of 100,000 splats, in scene units: up to 3 pixels far, 8 pixels near."""
SEED = 42

RANDOM = "random:"
"""Beginning of the name of a workload of random splats; their number follows."""
FULL_HD = (1920, 1080)


@dataclass(frozen=True)
class Workload:
    """Splats and cameras to render; float32."""

    name: str
    """Path of the file, or the way in which the splats were made."""
    splats: Splats
    cameras: Cameras

    @property
    def description(self) -> str:
        """Numbers of splats and cameras, and sizes, as a phrase."""
        splats, cameras = self.splats, self.cameras
        colors = splats.colors
        kind = f"SH degree {colors.degree}" if isinstance(colors, Sh) else "RGB"
        views = "one camera" if len(cameras) == 1 else f"{len(cameras)} cameras"
        return f"{len(splats):,} splats, {kind}, {views} of {cameras.width}x{cameras.height}"

    def to(self, device: torch.device) -> Workload:
        """The same on another device."""
        splats = self.splats.map(lambda tensor: tensor.to(device))
        return replace(self, splats=splats, cameras=self.cameras.to(device))

    def copied(self, copies: int) -> Workload:
        """``copies`` x ``copies`` of the splats side by side along the world's x and y.

        The copies are as far apart as the splats' centres reach, and the cameras stay with the one
        in the middle. The "scene_grid" of gsplat's own profiler stands for a large scene like this.
        """
        if copies == 1:
            return self
        means = self.splats.means
        reach = (means.amax(0) - means.amin(0)) * means.new_tensor([1.0, 1.0, 0.0])
        places = torch.arange(copies, dtype=means.dtype, device=means.device) - copies // 2
        x, y = (axis.flatten() for axis in torch.meshgrid(places, places, indexing="ij"))
        shifts = torch.stack([x, y, torch.zeros_like(x)], 1) * reach
        splats = self.splats.map(lambda tensor: torch.cat([tensor] * len(shifts)))
        means = splats.means + shifts.repeat_interleave(len(means), 0)
        name = f"{self.name}, {copies}x{copies} copies"
        return replace(self, name=name, splats=replace(splats, means=means))

    def sized(self, width: int, height: int) -> Workload:
        """The same in images of another size, whose axes are stretched to it."""
        return replace(self, cameras=self.cameras.resized(width, height))


def read_workload(path: Path) -> Workload:
    """Read a workload from an npz file.

    Raises:
        DataError: it is absent, is no npz file, lacks a field, or holds a wrong shape or value.
    """
    arrays = _arrays(path)
    for name, shapes in _expected(arrays).items():
        if arrays[name].shape not in shapes:
            wanted = " or ".join(str(list(shape)) for shape in shapes)
            raise DataError(
                f"workload={path}: {name}: expected shape {wanted}, "
                f"found {list(arrays[name].shape)}.",
                ADVICE,
            )
    splats, cameras = _splats(arrays), _cameras(path, arrays)
    try:
        check_values(splats, cameras, RenderSettings())
    except ValueError as error:
        raise DataError(f"workload={path}: {error}.", ADVICE) from None
    return Workload(str(path), splats, cameras)


def _arrays(path: Path) -> Mapping[str, Array]:
    """Every field, as float32.

    Raises:
        DataError: the file is absent, is no npz file, lacks a field, or holds one without numbers.
    """
    if not path.is_file():
        raise DataError(f"workload={path}: there is no such file.", ADVICE)
    try:
        if not zipfile.is_zipfile(path):
            raise ValueError("it is no zip archive of arrays, or was cut off")
        names = array_names(path)
        raw = {name: read_array(path, name) for name in FIELDS if name in names}
        found = ", ".join(names) or "nothing"
    except (OSError, ValueError) as error:  # A DataError is a ValueError.
        reason = error.message if isinstance(error, DataError) else error
        raise DataError(
            f"workload={path}: this is not an npz file that can be read: {reason}.", ADVICE
        ) from None
    for name in FIELDS:
        if name not in raw:
            raise DataError(f"workload={path}: {name} is missing; the file holds {found}.", ADVICE)
        if raw[name].dtype.kind not in "fiu":
            raise DataError(
                f"workload={path}: {name}: expected numbers, found {raw[name].dtype}.", ADVICE
            )
    with np.errstate(over="ignore"):  # Too large for float32 becomes inf, which is refused.
        return {name: np.array(value, dtype=np.float32) for name, value in raw.items()}


def _expected(arrays: Mapping[str, Array]) -> dict[str, list[tuple[int, ...]]]:
    """The shapes that each field may have, given how many splats and cameras there are."""
    n = max(arrays["means"].shape[0], 1) if arrays["means"].ndim else 1
    pose = arrays["world_to_camera"]
    c = max(pose.shape[0], 1) if pose.ndim == 3 else 1
    harmonics = [(n, num_coefficients(degree), 3) for degree in range(MAX_DEGREE + 1)]
    return {
        "means": [(n, 3)],
        "quats": [(n, 4)],
        "scales": [(n, 3)],
        "opacities": [(n,)],
        "colors": [(n, 3), *harmonics],
        "world_to_camera": [(c, 4, 4)] if pose.ndim == 3 else [(4, 4)],
        "intrinsics": [(3, 3), (c, 3, 3)],
        "width": [(), (1,)],
        "height": [(), (1,)],
    }


def _splats(arrays: Mapping[str, Array]) -> Splats:
    fields = {name: torch.from_numpy(arrays[name]) for name in FIELDS[:5]}
    colors: Sh | Tensor = fields["colors"]
    if fields["colors"].ndim == 3:
        colors = Sh(fields["colors"], round(fields["colors"].shape[1] ** 0.5) - 1)
    return Splats(fields["means"], fields["opacities"], colors, fields["quats"], fields["scales"])


def _cameras(path: Path, arrays: Mapping[str, Array]) -> Cameras:
    """The cameras; a single matrix of intrinsics holds for all.

    Raises:
        DataError: the size of the images is not valid.
    """
    sides = {name: float(arrays[name].reshape(())) for name in ("width", "height")}
    for name, side in sides.items():
        if not (1 <= side <= MAX_SIDE and side == int(side)):
            raise DataError(
                f"workload={path}: {name}: expected a whole number from 1 to {MAX_SIDE}, "
                f"found {side:g}.",
                ADVICE,
            )
    poses = torch.from_numpy(arrays["world_to_camera"]).view(-1, 4, 4)
    intrinsics = torch.from_numpy(arrays["intrinsics"]).view(-1, 3, 3)
    intrinsics = intrinsics.expand(len(poses), 3, 3).contiguous()
    return Cameras(poses, intrinsics, int(sides["width"]), int(sides["height"]))


def scattered(
    count: int, width: int, height: int, device: torch.device, seed: int = SEED
) -> tuple[Splats, Cameras]:
    """Random splats in front of one camera and around its image; the same for the same seed.

    Sizes and opacities are distributed as in the workload "garden" of docs/results/performance.md.
    Sizes shrink with the square root of the number of splats, so that 50 to 62 of them contribute
    to each pixel of any image, from 100,000 to 5,000,000 splats.
    """
    generator = torch.Generator(device).manual_seed(seed)

    def uniform(columns: int, low: float, high: float) -> Tensor:
        numbers = torch.rand(count, columns, generator=generator, device=device)
        return low + (high - low) * numbers

    focal = FOCAL * width
    shrink = (SPLATS / max(count, 1)) ** 0.5
    depth = uniform(1, NEAREST, FURTHEST)
    edges = 0.5 * SPREAD / focal * torch.tensor([width, height], device=device)
    splats = Splats(
        means=torch.cat([uniform(2, -1.0, 1.0) * edges * depth, depth], dim=1),
        quats=torch.randn(count, 4, generator=generator, device=device),
        scales=uniform(3, SMALLEST_SCALE * shrink, LARGEST_SCALE * shrink),
        opacities=uniform(1, 0.0, 1.0)[:, 0],
        colors=uniform(3, 0.0, 1.0),
    )
    intrinsics = torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return splats, Cameras(torch.eye(4)[None], intrinsics[None], width, height).to(device)


def built_in(device: torch.device) -> Workload:
    """The default workload, with 13.4 million contributing pairs.

    The random numbers come from the CPU, so that it is the same on every device.
    """
    splats, cameras = scattered(SPLATS, WIDTH, HEIGHT, torch.device("cpu"))
    return Workload("built in", splats, cameras).to(device)


def random_workload(text: str, device: torch.device) -> Workload:
    """A workload of random splats at 1920x1080.

    Raises:
        ConfigError: ``text`` is not ``random:COUNT``.
    """
    given = text.removeprefix(RANDOM)
    count = int(given) if given.isdecimal() else 0
    if not 1 <= count < 2**31:
        raise ConfigError(
            f"workload={text}: expected a number of splats after {RANDOM}, found {given!r}.",
            f"Write it in digits: workload={RANDOM}1000000",
        )
    return Workload(text, *scattered(count, *FULL_HD, device))
