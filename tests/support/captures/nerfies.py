"""A small capture as the data sets of Nerfies are."""

import json
from dataclasses import replace

import numpy as np

from support.small_captures import HEIGHT, WIDTH, ring, write_image

FOCAL, ASPECT, CENTER = 70.0, 1.03, (31.0, 25.5)
NAMES = [f"left1_{number:06d}" for number in range(5)]


def capture():
    """The ring, seen with the lens of the camera files."""
    return replace(ring(5), names=NAMES, focal=(FOCAL, FOCAL * ASPECT), center=CENTER)


def write(folder, train=(0, 2, 4), held=(1, 3), scales=(1, 2), camera=(), **dataset):
    """The data set; ``camera`` replaces settings of the camera files."""
    made = capture()
    (folder / "camera").mkdir(parents=True)
    for name, pose in zip(NAMES, made.poses, strict=True):
        content = {
            "orientation": pose[:3, :3].tolist(),
            "position": (-pose[:3, :3].T @ pose[:3, 3]).tolist(),
            "focal_length": FOCAL,
            "principal_point": CENTER,
            "skew": 0.0,
            "pixel_aspect_ratio": ASPECT,
            "radial_distortion": [0.0, 0.0, 0.0],
            "tangential_distortion": [0.0, 0.0],
            "image_size": [WIDTH, HEIGHT],
        }
        (folder / f"camera/{name}.json").write_text(json.dumps(content | dict(camera)))
        for scale in scales:
            write_image(folder / f"rgb/{scale}x/{name}.png", WIDTH // scale, HEIGHT // scale)
    lists = {
        "count": 5,
        "ids": NAMES,
        "train_ids": [NAMES[number] for number in train],
        "val_ids": [NAMES[number] for number in held],
    }
    (folder / "dataset.json").write_text(json.dumps(lists | dataset))
    metadata = {
        name: {"warp_id": 3 * number, "appearance_id": 0, "camera_id": number % 2}
        for number, name in enumerate(NAMES)
    }
    (folder / "metadata.json").write_text(json.dumps(metadata))
    scene = {"scale": 0.02, "center": [1.0, 2.0, 3.0], "near": 0.1, "far": 2.0}
    (folder / "scene.json").write_text(json.dumps(scene))
    np.save(folder / "points.npy", made.points.astype(np.float32))
    return folder
