"""Calibration files of several cameras, in which a small capture is seen."""

import json

import numpy as np

from support.small_captures import CENTER, FOCAL, HEIGHT, WIDTH, rotation_vector
from support.small_videos import cameras

K = [[FOCAL[0], 0.0, CENTER[0] - 0.5], [0.0, FOCAL[1], CENTER[1] - 0.5], [0.0, 0.0, 1.0]]
"""Intrinsics in OpenCV's pixels."""


def entry(number=0, **settings):
    """A camera's settings; ``None`` removes one."""
    content = {"name": f"cam{number:02d}", "w": WIDTH, "h": HEIGHT, "K": K}
    content["w2c"] = cameras().poses[number].tolist()
    return {key: value for key, value in (content | settings).items() if value is not None}


def write_json(path, *entries):
    """An object with a list of cameras."""
    path.write_text(json.dumps({"cameras": list(entries)}))
    return path


def write_toml(path, count=1, distortion=(0.0, 0.0, 0.0, 0.0)):
    """As Pose2Sim writes it."""
    tables = [
        f'[cam_{number:02d}]\nname = "cam{number:02d}"\nsize = [ {WIDTH}.0, {HEIGHT}.0]\n'
        f"matrix = {K}\ndistortions = {list(distortion)}\n"
        f"rotation = {rotation_vector(pose[:3, :3])}\ntranslation = {pose[:3, 3].tolist()}\n"
        "fisheye = false\n\n"
        for number, pose in enumerate(cameras().poses[:count])
    ]
    path.write_text("".join(tables) + "[metadata]\nadjusted = false\nerror = 0.0\n")
    return path


def write_qualisys(path, **settings):
    """What Qualisys Track Manager exports: 64ths of a pixel, millimetres, cameras along -z."""
    pose = cameras().poses[0]
    rotation = np.diag([1.0, -1.0, -1.0]) @ pose[:3, :3]
    center = -1000 * pose[:3, :3].T @ pose[:3, 3]
    values = {"viewrotation": 0, "left": 8, "fu": 64 * FOCAL[0]} | settings
    transform = " ".join(f'r{i + 1}{j + 1}="{rotation[i, j]}"' for i in range(3) for j in range(3))
    transform += "".join(f' {axis}="{value}"' for axis, value in zip("xyz", center, strict=True))
    path.write_text(
        "<calibration><cameras>"
        f'<camera serial="cam00" viewrotation="{values["viewrotation"]}">'
        f'<fov_video left="{values["left"]}" top="0" right="{WIDTH + 7}" bottom="{HEIGHT - 1}"/>'
        f"<transform {transform}/>"
        f'<intrinsic focalLengthU="{values["fu"]}" focalLengthV="{64 * FOCAL[1]}" '
        f'centerPointU="{64 * (CENTER[0] + 7.5)}" centerPointV="{64 * (CENTER[1] - 0.5)}" '
        'radialDistortion1="0.1" radialDistortion2="0.2" tangentalDistortion1="0.01" '
        'tangentalDistortion2="0.02"/></camera></cameras></calibration>'
    )
    return path
