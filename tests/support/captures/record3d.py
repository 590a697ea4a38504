"""A small capture as Record3D exports a recording."""

import json

import torch

from gsfw.core.maths.rotations import quaternions_of
from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, opengl, ring, write_image

INTRINSICS = [FOCAL[0], 0, 0, 0, FOCAL[1], 0, *CENTER, 1]
"""K, column by column."""


def write(folder, views=4, file="metadata.json", images="rgb", **settings):
    """A recording; ``settings`` replace those of its file, and None removes one."""
    poses = []
    for number, pose in enumerate(ring(views).poses):
        matrix = torch.tensor(opengl(pose), dtype=torch.float64)
        w, x, y, z = quaternions_of(matrix[:3, :3]).tolist()
        poses.append([x, y, z, w, *matrix[:3, 3].tolist()])
        write_image(folder / images / f"{number}.jpg")
    content = {"w": WIDTH, "h": HEIGHT, "fps": 60, "K": INTRINSICS, "poses": poses} | settings
    content = {key: value for key, value in content.items() if value is not None}
    (folder / file).write_text(json.dumps(content))
    return folder
