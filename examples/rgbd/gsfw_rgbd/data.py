"""The ``tum-rgbd`` format of the TUM RGB-D benchmark (Sturm et al. 2012), as many datasets have it.

rgb.txt and depth.txt list images by time in seconds, groundtruth.txt poses: time tx ty tz qx qy qz
qw, camera to world, in metres. Depth images have 16 bits. Rows are matched by time. gsfw
undistorts, shrinks, masks and caches the depth maps with the images.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import torch

from gsfw.api import (
    CaptureConfig,
    DataError,
    Detection,
    Frame,
    Lens,
    MapFile,
    Recording,
    Resampling,
    Split,
    number,
    pose_from_center,
    read_header,
    rotation_matrices,
)
from gsfw_rgbd.points import surface_points

LISTS = ("rgb.txt", "depth.txt", "groundtruth.txt")
DETECTED = ", ".join(LISTS)
LENS_FILE = "intrinsics.txt"
"""fx fy cx cy of the images as stored, if it is beside the lists (TUM states them on its page)."""


@dataclass(kw_only=True)
class TumConfig(CaptureConfig):
    """Settings of the ``tum-rgbd`` format."""

    own_maps: ClassVar[frozenset[str]] = frozenset({"depth"})

    every: int = number(1, at_least=1)
    """One image of so many is taken."""
    lens: tuple[float, ...] = (525.0, 525.0, 319.5, 239.5)
    """fx,fy,cx,cy in pixels, unless the data set has an intrinsics.txt; the default is TUM's."""
    depth_scale: float = number(5000.0, above=0)
    """Stored depth of a metre."""
    longest_gap: float = number(0.02, above=0)
    """Most seconds between an image and its depth or its pose; others are left out."""
    points: int = number(20_000, at_least=0)
    """Points to start from, taken from the depth maps of the training images; 0: none."""
    held_out_every: int = number(8, at_least=2)
    """One image of so many is held out, from the first on; points come from the others alone."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        found = all((path / name).is_file() for name in LISTS)
        return Detection(found, DETECTED, LISTS[0] if found else "", priority=50)

    def recording(self, path: Path, downscale: float) -> Recording:
        images, *others = (read_list(path / name) for name in LISTS)
        depths, poses = ((list(rows), list(rows.values())) for rows in others)
        frames, lost = [], 0
        for time, (name, *_) in list(images.items())[:: self.every]:
            depth, pose = (self._nearest(rows, time) for rows in (depths, poses))
            if depth is None or pose is None:
                lost += 1
                continue
            file = MapFile(path / depth[0], Resampling.DEPTH, 1 / self.depth_scale)
            held_out = len(frames) % self.held_out_every == 0
            split = Split.EVAL if held_out else Split.TRAIN
            frames.append(self._frame(path, name, file, pose, split))
        if not frames:
            raise DataError(
                f"{path}: no image has a depth map and a pose within "
                f"datamanager.longest_gap={self.longest_gap:g} seconds.",
                "Ask for a longer gap, or check the times in the three lists.",
            )
        trained = [frame for frame in frames if frame.split is Split.TRAIN]
        points, colors = surface_points(trained, self.points)
        note = f"{lost} images without depth or pose are left out"
        return Recording(
            name=path.resolve().name,
            path=path,
            frames=tuple(frames),
            points=points,
            point_colors=colors,
            notes=(f"{path}: {len(frames)} images with depth", *((note,) if lost else ())),
            up="z",
            split_origin=f"one of {self.held_out_every} by time",
        )

    def _nearest(self, rows, time):
        """The row nearest in time; ``None`` if it is too far. ``rows`` ascend in time."""
        times, found = rows
        place = bisect_left(times, time)
        near = range(max(place - 1, 0), min(place + 1, len(times)))
        nearest = min(near, key=lambda index: abs(times[index] - time), default=None)
        is_far = nearest is None or abs(times[nearest] - time) > self.longest_gap
        return None if is_far else found[nearest]

    def _frame(self, path, name, depth, pose, split):
        header = read_header(path / name)
        return Frame(
            name,
            path / name,
            header,
            Lens(*self._lens(path), header.width, header.height, str(path)),
            world_to_camera(pose, f"{path / LISTS[2]}: the pose of {name}"),
            split=split,
            maps={"depth": depth},
        )

    def _lens(self, path):
        file = path / LENS_FILE
        values = file.read_text("utf-8").split() if file.is_file() else self.lens
        try:
            fx, fy, cx, cy = map(float, values)
        except ValueError:
            source = file if file.is_file() else f"datamanager.lens={self.lens}"
            raise DataError(f"{source}: expected four numbers, fx fy cx cy.") from None
        return fx, fy, cx, cy


def read_list(file):
    """The rest of each line after its time, by ascending time; # begins a comment.

    The lines of groundtruth.txt have seven numbers, those of the others the name of a file.
    """
    rows, is_poses = {}, file.name == LISTS[2]
    try:
        lines = file.read_text("utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{file} cannot be read: {error}.", f"Expected {DETECTED}.") from error
    for place, line in enumerate(lines, start=1):
        time, *words = line.partition("#")[0].split() or [""]
        if not time:
            continue
        try:
            rows[float(time)] = tuple(map(float, words)) if is_poses else words
            if len(words) < (7 if is_poses else 1):
                raise ValueError
        except ValueError:
            expected = "a time and seven numbers" if is_poses else "a time and a file"
            raise DataError(f"{file}:{place}: expected {expected}, found {line!r}.") from None
    return dict(sorted(rows.items()))


def world_to_camera(pose, where):
    """The rigid transform [4, 4] of tx ty tz qx qy qz qw, which is camera to world."""
    center, (x, y, z, w) = torch.tensor(pose[:3], dtype=torch.float64), pose[3:7]
    axes = rotation_matrices(torch.tensor([[w, x, y, z]], dtype=torch.float64))[0]
    return pose_from_center(axes.T, center, where)
