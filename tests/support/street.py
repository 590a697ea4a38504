"""A street from above: points on the ground in two clusters, and cameras that look down on them."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from gsfw.core.files.ply_file import ply_header

SIDE = 32


def write_street(
    folder: Path,
    views: int = 16,
    points: int = 400,
    origin=(0.0, 0.0, 0.0),
    length: float = 12.0,
    cameras: tuple[float, float] | None = None,
) -> Path:
    """A transforms.json with flat images, and points in double precision.

    Args:
        folder: is made.
        views: cameras, evenly along the street.
        points: of the ground.
        origin: place of the street in the world.
        length: of the street.
        cameras: the part of the street that they stand over; ``None``: all of it.
    """
    generator = np.random.default_rng(3)
    (folder / "images").mkdir(parents=True)
    places = generator.uniform(-0.5, 0.5, (points, 3)) * np.array([length, 3.0, 0.2])
    low, high = cameras or (-length / 2, length / 2)
    frames = []
    for number in range(views):
        x = low + (high - low) * (number + 0.5) / views
        pose = np.eye(4)  # OpenGL's camera looks along -z: straight down.
        pose[:3, 3] = np.array([x, 0.3 * (-1) ** number, 2.0]) + np.array(origin)
        name = f"images/{number:03d}.png"
        shade = np.full((SIDE, SIDE, 3), 90 + number, np.uint8)
        shade[: SIDE // 2] += 60
        Image.fromarray(shade).save(folder / name)
        frames.append({"file_path": name, "transform_matrix": pose.tolist()})
    records = np.empty(points, [("place", "<f8", 3), ("color", "u1", 3)])
    records["place"] = places + np.array(origin)
    records["color"] = generator.integers(0, 256, (points, 3))
    kinds = [("double", "x"), ("double", "y"), ("double", "z")]
    kinds += [("uchar", name) for name in ("red", "green", "blue")]
    (folder / "points.ply").write_bytes(
        ply_header([], {"vertex": (points, kinds)}) + records.tobytes()
    )
    document = {
        **{"fl_x": 28.0, "fl_y": 28.0, "cx": SIDE / 2, "cy": SIDE / 2, "w": SIDE, "h": SIDE},
        **{"ply_file_path": "points.ply", "frames": frames},
    }
    (folder / "transforms.json").write_text(json.dumps(document))
    return folder
