"""A small capture as Polycam exports its keyframes."""

import json

import numpy as np

from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, opengl, ring, write_images


def write(folder, prefix="", views=4, **settings):
    """Keyframes as Polycam names them; ``settings`` replace those of a camera, None removes one."""
    capture = ring(views)
    cameras = folder / f"keyframes/{prefix}cameras"
    cameras.mkdir(parents=True)
    write_images(folder / f"keyframes/{prefix}images", capture)
    for number, (pose, name) in enumerate(zip(capture.poses, capture.names, strict=True)):
        content = {
            "fx": FOCAL[0], "fy": FOCAL[1], "cx": CENTER[0], "cy": CENTER[1],
            "width": WIDTH, "height": HEIGHT, "blur_score": 50.0 + 10 * number, "timestamp": 1,
        }  # fmt: skip
        matrix = np.array(opengl(pose))
        content |= {f"t_{i}{j}": matrix[i, j] for i in range(3) for j in range(4)}
        content = {k: value for k, value in (content | settings).items() if value is not None}
        (cameras / name).with_suffix(".json").write_text(json.dumps(content))
    return folder
