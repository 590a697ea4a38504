"""Captures of the built-in scene as files, so that anything in them can be made wrong."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from PIL import Image

from gsfw.core.color_bytes import color_bytes
from gsfw.core.datamanager import DataRequest, Split
from gsfw.datamanagers.point_file import ply_of
from gsfw.datamanagers.synthetic.config import SyntheticConfig

WIDTH, HEIGHT, TIMES = 40, 30, 4
GRAPHICS_AXES = np.diag([1.0, -1.0, -1.0, 1.0])
"""Turns the axes of OpenCV's cameras into those of OpenGL's, which transforms.json has."""


@dataclass(frozen=True)
class Capture:
    """All that is in a data set; any number in it may be wrong."""

    poses: NDArray[np.float64]
    """Camera to world, with the axes of OpenGL: [v, 4, 4]."""
    images: tuple[NDArray[np.generic], ...]
    """Each [h, w, d] with 8 bits, or [h, w] with floating-point numbers."""
    points: NDArray[np.float64]
    """[p, 3]."""
    colors: NDArray[np.float64]
    """In [0, 1]: [p, 3]."""
    focal: tuple[float, float]
    """Pixels."""
    times: tuple[float, ...] | None = None
    """Time of each view, in seconds."""

    def first(self, views: int) -> Capture:
        """The first views alone."""
        times = None if self.times is None else self.times[:views]
        return replace(self, poses=self.poses[:views], images=self.images[:views], times=times)

    def write(self, folder: Path) -> Path:
        """Write a transforms.json, its images and its points; returns the folder."""
        folder.mkdir(parents=True)
        frames = []
        for view, (pose, image) in enumerate(zip(self.poses, self.images, strict=True)):
            name = f"{view:03d}.{'png' if image.dtype == np.uint8 else 'tif'}"
            Image.fromarray(image).save(folder / name)
            frame: dict[str, object] = {"file_path": name, "transform_matrix": pose.tolist()}
            frames.append(frame if self.times is None else frame | {"time": self.times[view]})
        document: dict[str, object] = {"fl_x": self.focal[0], "fl_y": self.focal[1]}
        height, width = self.images[0].shape[:2]
        document |= {"cx": width / 2, "cy": height / 2, "w": width, "h": height}
        if len(self.points):
            places, colors = map(torch.from_numpy, (self.points, self.colors))
            (folder / "points.ply").write_bytes(ply_of(places, colors))
            document["ply_file_path"] = "points.ply"
        (folder / "transforms.json").write_text(json.dumps(document | {"frames": frames}))
        return folder


@cache
def photographed(moving: bool) -> Capture:
    """The built-in scene, still or moving, as any camera would have it."""
    config = SyntheticConfig(12, 0, WIDTH, HEIGHT, 300, moving, TIMES)
    data = config.build(DataRequest(None))
    cameras = data.views(Split.TRAIN).cameras
    white, cpu = torch.ones(3), torch.device("cpu")
    images, poses = [], []
    for view, camera in enumerate(cameras):
        (batch,) = data.load(Split.TRAIN, [view], cpu)
        images.append(color_bytes(batch.target(white)[0]).numpy())
        poses.append(np.linalg.inv(camera.world_to_camera[0].double().numpy()) @ GRAPHICS_AXES)
    intrinsics = cameras[0].intrinsics[0]
    times = tuple(float(camera.time[0]) for camera in cameras if camera.time is not None)
    scene = data.scene
    data.close()
    return Capture(
        np.stack(poses),
        tuple(images),
        scene.points.double().numpy(),
        scene.point_colors.double().numpy(),
        (float(intrinsics[0, 0]), float(intrinsics[1, 1])),
        times if moving else None,
    )
