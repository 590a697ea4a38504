"""A small capture as OpenSfM writes its reconstruction."""

import json

from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, ring, rotation_vector, write_images

LONGER = max(WIDTH, HEIGHT)
BROWN = {
    "projection_type": "brown", "width": WIDTH, "height": HEIGHT,
    "focal_x": FOCAL[0] / LONGER, "focal_y": FOCAL[1] / LONGER,
    "c_x": (CENTER[0] - WIDTH / 2) / LONGER, "c_y": (CENTER[1] - HEIGHT / 2) / LONGER,
}  # fmt: skip
TERMS = {"k1": -0.1, "k2": 0.05, "k3": -0.02, "p1": 2e-3, "p2": -3e-3}


def reconstruction(camera=BROWN, views=4, **parts):
    capture = ring(4)
    shots = {
        name: {
            "camera": "v2 unknown", "rotation": rotation_vector(pose[:3, :3]),
            "translation": pose[:3, 3].tolist(), "orientation": 1,
        }
        for pose, name in list(zip(capture.poses, capture.names, strict=True))[:views]
    }  # fmt: skip
    points = {
        str(number): {"coordinates": point.tolist(), "color": color.tolist()}
        for number, (point, color) in enumerate(zip(capture.points, capture.colors, strict=True))
    }
    return {"cameras": {"v2 unknown": camera}, "shots": shots, "points": points} | parts


def write(folder, *reconstructions, images="images"):
    write_images(folder / images, ring())
    content = list(reconstructions) or [reconstruction()]
    (folder / "reconstruction.json").write_text(json.dumps(content))
    return folder
