"""Captures on disk that `gsfw check` looks at: a patterned ball, as good or as bad as asked for."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image

from gsfw.core.datamanager import DataRequest
from gsfw.datamanagers.blender import BlenderConfig
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.preparation.check.examination import judge
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding
from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, SmallCapture, write_colmap

BALL = 0.35
"""Radius; cameras are at about 1."""


def pattern(points: np.ndarray) -> np.ndarray:
    """Colours in [0, 1] of places in the world."""
    return 0.5 + 0.35 * np.sin(20 * points + np.array([0.0, 1.0, 2.0]))


def looking_at(center: np.ndarray, target: np.ndarray) -> np.ndarray:
    """World to camera, OpenCV axes, with z up in the world."""
    forward = (target - center) / np.linalg.norm(target - center)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, -rotation @ center
    return pose


def ball(centers: np.ndarray | None = None, count: int = 24, points: int = 1500) -> SmallCapture:
    """Cameras that look at a ball around the origin, and points on it."""
    generator = np.random.default_rng(3)
    if centers is None:
        angles = 2 * np.pi * np.arange(count) / count
        heights = 0.3 + 0.15 * np.cos(3 * angles)
        centers = np.stack([np.cos(angles), np.sin(angles), heights], axis=1)
    surface = generator.normal(size=(points, 3))
    surface *= BALL / np.linalg.norm(surface, axis=1, keepdims=True)
    return SmallCapture(
        [looking_at(center, np.zeros(3)) for center in centers],
        surface,
        [f"view_{index:03d}.png" for index in range(len(centers))],
        (255 * pattern(surface)).astype(np.uint8),
    )


def photo(pose: np.ndarray) -> np.ndarray:
    """What a camera sees of the ball, with far walls behind it; 8 bits."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    rays = np.stack(
        [(columns - CENTER[0]) / FOCAL[0], (rows - CENTER[1]) / FOCAL[1], np.ones_like(rows)], -1
    )
    rays = rays @ pose[:3, :3]
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    center = -pose[:3, :3].T @ pose[:3, 3]
    along = -(rays @ center)
    inside = BALL**2 - (center @ center - along**2)
    hit = center + (along - np.sqrt(np.maximum(inside, 0)))[..., None] * rays
    colors = np.where((inside > 0)[..., None], pattern(hit), 0.6 + 0.2 * np.sin(15 * rays))
    return (255 * colors).astype(np.uint8)


@dataclass(frozen=True)
class Written:
    """A COLMAP capture on disk."""

    folder: Path
    capture: SmallCapture

    def change(self, views: Sequence[int], edit: Callable[[np.ndarray], np.ndarray]) -> None:
        """Write some of the images anew."""
        for view in views:
            path = self.folder / "images" / self.capture.names[view]
            Image.fromarray(edit(np.asarray(Image.open(path)))).save(path)

    def survey(self, images: int | None = None) -> Survey:
        """Look at it."""
        data = ColmapConfig().build(DataRequest(self.folder))
        survey = Survey.of(data, images)
        data.close()
        return survey

    def findings(self, images: int | None = None) -> dict[str, Finding]:
        """Everything that is found, by kind."""
        return {finding.kind: finding for finding in judge(self.survey(images))}


def write_ball(folder: Path, capture: SmallCapture | None = None, **model: object) -> Written:
    """A COLMAP capture of the ball; ``model`` as ``write_colmap`` takes it."""
    capture = ball() if capture is None else capture
    (folder / "images").mkdir(parents=True)
    for pose, name in zip(capture.poses, capture.names, strict=True):
        Image.fromarray(photo(pose)).save(folder / "images" / name)
    write_colmap(folder / "sparse" / "0", capture, **model)
    return Written(folder, capture)


def with_points(capture: SmallCapture, points: np.ndarray) -> SmallCapture:
    """The same cameras with other points."""
    colors = np.full((len(points), 3), 128, np.uint8)
    return replace(capture, points=points, colors=colors)


def write_moving(folder: Path, times: Sequence[float], cameras: int, moves: float = 0.2) -> Path:
    """Standing cameras in the D-NeRF layout, each with an image at every time.

    Args:
        folder: where it goes.
        times: of the images.
        cameras: how many.
        moves: how far, in widths of the image, a bar moves through it.
    """
    frames = []
    (folder / "train").mkdir(parents=True)
    for number, pose in enumerate(ball(count=cameras).poses):
        still = photo(pose)
        to_world = np.linalg.inv(pose) @ np.diag([1.0, -1.0, -1.0, 1.0])
        for time in times:
            image = still.copy()
            left = int(WIDTH * (0.3 + moves * time))
            image[10:30, left : left + 10] = (250, 30, 30)
            name = f"c{number}_{round(1000 * time):04d}"
            Image.fromarray(image).save(folder / "train" / f"{name}.png")
            frames.append(
                {
                    "file_path": f"train/{name}",
                    "time": time,
                    "transform_matrix": to_world.tolist(),
                }
            )
    document = {"camera_angle_x": 0.86, "frames": frames}
    (folder / "transforms_train.json").write_text(json.dumps(document))
    return folder


def moving_findings(folder: Path) -> dict[str, Finding]:
    """Everything that is found in a capture that ``write_moving`` made, by kind."""
    data = BlenderConfig().build(DataRequest(folder, eval_every_nth=0))
    findings = judge(Survey.of(data, 0))
    data.close()
    return {finding.kind: finding for finding in findings}
