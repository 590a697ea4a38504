"""Captures of the built-in scene by cameras on an arc, which can be spoiled: see faults."""

from pathlib import Path

import numpy as np
import torch
from made_capture import MadeCapture

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataRequest
from gsfw.core.maths.camera_path import look_at
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.datamanagers.synthetic.raycast import photograph
from gsfw.datamanagers.synthetic.scene import SyntheticScene, solids
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.preparation.check.examination import judge
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding

WIDTH, HEIGHT = 240, 180
FOCAL = 260.0


def cast_capture(count: int = 24, wander: float = 0.0) -> MadeCapture:
    """Cameras beside each other, every other one higher; images with alpha.

    Args:
        count: of the cameras.
        wander: how far apart the places lie that cameras look at.
    """
    angles = torch.deg2rad(torch.linspace(0, 110, count, dtype=torch.float64))
    heights = 1.4 + 0.5 * (torch.arange(count) % 2)
    centers = torch.stack([4.2 * angles.cos(), 4.2 * angles.sin(), heights], dim=1)
    steps = wander * torch.tensor([[0.3, -1.0, 0.0], [-1.0, 0.5, 0.2], [0.7, 1.0, -0.2]])
    targets = torch.tensor([0.0, 0.0, 0.1]).double() + steps[torch.arange(count) % 3].double()
    up = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    poses = torch.cat(
        [look_at(one[None], target, up) for one, target in zip(centers, targets, strict=True)]
    )
    matrix = torch.tensor(
        [[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]], dtype=torch.float64
    )
    scene = SyntheticScene(solids(0), 0.0)
    cameras = [Cameras(pose[None], matrix[None], WIDTH, HEIGHT) for pose in poses]
    images = tuple(photograph(scene, camera).numpy() for camera in cameras)
    data = SyntheticConfig(points=1500, views=12, eval_views=0, width=64, height=48).build(
        DataRequest(None)
    )
    points = data.scene.world_from_scene.apply(data.scene.points).numpy()
    colors = (255 * data.scene.point_colors.numpy()).astype(np.uint8)
    data.close()
    return MadeCapture(
        tuple(f"view_{number:02d}" for number in range(count)),
        images,
        poses.numpy(),
        np.tile([FOCAL, FOCAL, WIDTH / 2, HEIGHT / 2], (count, 1)),
        points,
        colors,
    )


def survey_of(capture: MadeCapture, folder: Path) -> Survey:
    """Write it and look at it."""
    data = TransformsConfig().build(DataRequest(capture.write(folder)))
    survey = Survey.of(data, 0)
    data.close()
    return survey


def findings_of(capture: MadeCapture, folder: Path) -> dict[str, Finding]:
    """Everything that is found in it, by kind, the gravest first."""
    return {finding.kind: finding for finding in judge(survey_of(capture, folder))}
