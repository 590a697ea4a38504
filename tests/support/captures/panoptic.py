"""A small capture as the data sets of dynamic3dgs are."""

import json

import numpy as np
from PIL import Image

from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, write_image
from support.small_videos import cameras, over_time

TIMES = 3
K = [[FOCAL[0], 0.0, CENTER[0]], [0.0, FOCAL[1], CENTER[1]], [0.0, 0.0, 1.0]]
OWNERS = {"train_meta.json": (0, 1, 3), "test_meta.json": (2,)}


def name(camera, time):
    return f"{10 + camera}/{time:06d}.jpg"


def capture():
    names = [[name(camera, time) for time in range(TIMES)] for camera in range(4)]
    return over_time(cameras(4), names)


def write(folder, files=("train_meta.json", "test_meta.json"), **settings):
    """Images of 4 cameras, of which test_meta.json has one."""
    for camera in range(4):
        for time in range(TIMES):
            write_image(folder / "ims" / name(camera, time))
            seg = (folder / "seg" / name(camera, time)).with_suffix(".png")
            seg.parent.mkdir(parents=True, exist_ok=True)
            moving = np.zeros((HEIGHT, WIDTH), np.uint8)
            moving[:20, :30] = 255
            Image.fromarray(moving).save(seg)
    for file in files:
        own = OWNERS[file]
        content = {
            "w": WIDTH,
            "h": HEIGHT,
            "k": [[K for _ in own] for _ in range(TIMES)],
            "w2c": [[cameras(4).poses[c].tolist() for c in own] for _ in range(TIMES)],
            "fn": [[name(c, time) for c in own] for time in range(TIMES)],
            "cam_id": [[10 + c for c in own] for _ in range(TIMES)],
        }
        (folder / file).write_text(json.dumps(content | settings))
    points = cameras().points
    cloud = np.concatenate([points, np.full((20, 3), 0.25), np.ones((20, 1))], axis=1)
    np.savez(folder / "init_pt_cld.npz", data=cloud)
    return folder
