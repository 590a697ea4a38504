"""MadeCapture: a capture in memory, read from any data set, to be spoiled and written anew."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image

from gsfw.core.batch import Batch
from gsfw.core.color_bytes import color_bytes
from gsfw.core.datamanager import DataManager
from gsfw.core.loop.area import shrink_batch
from gsfw.datamanagers.point_file import ply_of
from gsfw.preparation.check.viewpoints import Viewpoints

OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""From OpenCV's axes of a camera to OpenGL's, and back."""
QUALITY = 95
"""Quality of the JPEG files."""


@dataclass(frozen=True)
class MadeCapture:
    """``v`` images with their cameras, and ``p`` points; written as a transforms.json."""

    names: tuple[str, ...]
    """Names of the files, without extension."""
    images: tuple[UInt8[np.ndarray, "h w d"], ...]
    """Red, green, blue, and alpha if the data set has it."""
    poses: Float[np.ndarray, "v 4 4"]
    """World to camera, OpenCV axes."""
    pinholes: Float[np.ndarray, "v 4"]
    """fx, fy, cx, cy in pixels of the images."""
    points: Float[np.ndarray, "p 3"]
    colors: UInt8[np.ndarray, "p 3"]
    times: Float[np.ndarray, " v"] | None = None
    mirrored: bool = False
    """Write poses of a left-handed world: its y axis is turned round."""
    masks: Sequence[tuple[str, UInt8[np.ndarray, "h w"]]] = ()
    """Files in masks/, and what they hold."""

    @staticmethod
    def of(data: DataManager, side: int, most: int, first: int = 0) -> MadeCapture:
        """Read a data set.

        Args:
            data: is closed after.
            side: longest side of an image, in pixels; larger ones are shrunk.
            most: number of images, spread evenly.
            first: of these, to take others.
        """
        with closing(data):
            viewpoints = Viewpoints.of(data)
            order = np.argsort(viewpoints.names, kind="stable")
            chosen = order[np.unique(np.linspace(first, len(order) - 1, most).astype(int))]
            images, pinholes = [], []
            for view in chosen.tolist():
                split, number = viewpoints.splits[view], viewpoints.numbers[view]
                (batch,) = data.load(split, [number], torch.device("cpu"))
                longest = int(viewpoints.sizes[view].max())
                width, height = (viewpoints.sizes[view] * min(1.0, side / longest)).round()
                batch = shrink_batch(batch, int(width), int(height))
                images.append(_pixels(batch))
                matrix = batch.cameras.intrinsics[0].double().numpy()
                pinholes.append((matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]))
            times = viewpoints.times
            return MadeCapture(
                names=tuple(
                    viewpoints.names[view].replace("/", "_").rsplit(".", 1)[0] for view in chosen
                ),
                images=tuple(images),
                poses=viewpoints.poses[chosen],
                pinholes=np.array(pinholes),
                points=data.scene.points.double().numpy(),
                colors=color_bytes(data.scene.point_colors).numpy(),
                times=None if times is None else times[chosen],
            )

    def __len__(self) -> int:
        return len(self.names)

    def reordered(self, order: Sequence[int]) -> MadeCapture:
        """The images in another order, with the poses as they were."""
        return replace(self, images=tuple(self.images[index] for index in order))

    def write(self, folder: Path) -> Path:
        """Write it into a new folder."""
        (folder / "images").mkdir(parents=True)
        frames = []
        for row, (name, pixels) in enumerate(zip(self.names, self.images, strict=True)):
            file = f"images/{name}.{'png' if pixels.shape[2] == 4 else 'jpg'}"
            Image.fromarray(pixels).save(folder / file, quality=QUALITY)
            frames.append(self._frame(row, file))
        document: dict[str, object] = {"frames": frames}
        if len(self.points):
            document["ply_file_path"] = "points.ply"
            self._write_points(folder / "points.ply")
        (folder / "transforms.json").write_text(json.dumps(document))
        for file, mask in self.masks:
            (folder / "masks").mkdir(exist_ok=True)
            Image.fromarray(mask).save(folder / "masks" / file, quality=QUALITY)
        return folder

    def _frame(self, row: int, file: str) -> dict[str, object]:
        height, width = self.images[row].shape[:2]
        to_world = np.linalg.inv(self.poses[row]) @ OPENGL
        if self.mirrored:
            to_world = np.diag([1.0, -1.0, 1.0, 1.0]) @ to_world
        frame: dict[str, object] = {"file_path": file, "transform_matrix": to_world.tolist()}
        frame |= dict(zip(("fl_x", "fl_y", "cx", "cy"), self.pinholes[row].tolist(), strict=True))
        frame |= {"w": width, "h": height}
        if self.times is not None:
            frame["time"] = float(self.times[row])
        return frame

    def _write_points(self, file: Path) -> None:
        points = torch.from_numpy(self.points).double()
        file.write_bytes(ply_of(points, torch.from_numpy(self.colors).float() / 255))


def _pixels(batch: Batch) -> UInt8[np.ndarray, "h w d"]:
    layers = [batch.images[0]]
    if batch.alpha is not None:
        layers.append(batch.alpha[0])
    return color_bytes(torch.cat(layers, dim=-1)).numpy()
