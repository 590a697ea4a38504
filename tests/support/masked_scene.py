"""The built-in moving scene as a data set on disk, with masks of what moves."""

import json
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from plyfile import PlyData, PlyElement

from gsfw.core.datamanager import DataRequest, Split
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.datamanagers.synthetic.raycast import SyntheticScene, show_change
from support.small_captures import opengl

HELD_OUT = "holdout=eval_000.png,eval_001.png"
CPU = torch.device("cpu")


def write_masked_scene(folder: Path) -> Path:
    """12 views of 4 times and 2 to hold out; masks/ is bright where a view shows a moving solid."""
    data = SyntheticConfig(
        moving=True, times=4, views=12, eval_views=2, width=32, height=24, points=400
    ).build(DataRequest(None))
    (folder / "masks").mkdir(parents=True)
    frames = []
    for split in Split:
        for index, name in enumerate(data.views(split).names):
            (batch,) = data.load(split, [index], CPU)
            camera = data._world[split][index]
            mask = show_change([SyntheticScene(data._solids, float(camera.time[0]))], camera)
            image = torch.cat([batch.images[0], batch.alpha[0]], dim=-1)
            Image.fromarray((255 * image).round().byte().numpy()).save(folder / f"{name}.png")
            Image.fromarray(255 * mask[..., 0].byte().numpy()).save(
                folder / "masks" / f"{name}.png"
            )
            k = camera.intrinsics[0]
            frames.append(
                {
                    "file_path": f"{name}.png",
                    "time": float(camera.time[0]),
                    "transform_matrix": opengl(camera.world_to_camera[0].numpy()),
                    **{"fl_x": float(k[0, 0]), "fl_y": float(k[1, 1])},
                    **{"cx": float(k[0, 2]), "cy": float(k[1, 2]), "w": 32, "h": 24},
                }
            )
    world = data.scene.world_from_scene.apply(data.scene.points.double())
    _write_points(folder / "points.ply", world.numpy(), data.scene.point_colors.numpy())
    content = {"frames": frames, "ply_file_path": "points.ply"}
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder


def _write_points(path: Path, points: np.ndarray, colors: np.ndarray) -> None:
    kinds = [(axis, "f4") for axis in "xyz"] + [(name, "u1") for name in ("red", "green", "blue")]
    rows = np.empty(len(points), kinds)
    for axis, values in zip("xyz", points.T, strict=True):
        rows[axis] = values
    for name, values in zip(("red", "green", "blue"), colors.T, strict=True):
        rows[name] = (255 * values).round()
    PlyData([PlyElement.describe(rows, "vertex")]).write(str(path))
