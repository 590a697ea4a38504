"""Cameras of a capture in a stage, to look through in viewers and to render again."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import torch

from gsfw.core.cameras import CameraModel, Cameras

if TYPE_CHECKING:
    from pxr import Usd, UsdGeom

WIDTH = 36.0
"""Width of the film, as of full-frame cameras. Only its ratio to the focal length is known."""
CLIPPING = (0.01, 1e6)
"""Nearest and farthest distance in units of the data; that of USD begins with 1."""
TO_USD = np.diag([1.0, -1.0, -1.0, 1.0])
"""From cameras of USD (y up, looking along -z) to those of OpenCV."""


def add_cameras(stage: Usd.Stage, cameras: Sequence[Cameras]) -> None:
    """Add each pinhole camera once, below the default prim; USD has no fisheye.

    Args:
        stage: has a default prim.
        cameras: in the axes of the stage.
    """
    pinholes = [each for each in cameras if each.model is CameraModel.PINHOLE]
    if not pinholes:
        return
    from pxr import UsdGeom

    scope = UsdGeom.Scope.Define(stage, stage.GetDefaultPrim().GetPath().AppendChild("Cameras"))
    known = set[bytes]()
    for each in pinholes:
        poses = torch.linalg.inv(each.world_to_camera.detach().double()).cpu().numpy()
        for pose, lens in zip(poses, each.intrinsics.detach().double().cpu().numpy(), strict=True):
            key = pose.tobytes() + lens.tobytes()  # A camera of a moving scene has many images.
            if key not in known:
                path = scope.GetPath().AppendChild(f"Camera_{len(known):04d}")
                _write(UsdGeom.Camera.Define(stage, path), pose, lens, each)
                known.add(key)


def _write(prim: UsdGeom.Camera, pose: np.ndarray, lens: np.ndarray, camera: Cameras) -> None:
    """Set pose and lens of a prim.

    Args:
        prim: the camera.
        pose: camera to world, [4, 4].
        lens: intrinsics, [3, 3] in pixels.
        camera: has the size of the image.
    """
    from pxr import Gf

    focal_length = lens[0, 0] * WIDTH / camera.width
    across, along = WIDTH / camera.width, focal_length / lens[1, 1]  # A pixel on the film.
    # The rows of matrices of USD are what the columns of others are.
    prim.AddTransformOp().Set(Gf.Matrix4d(*(pose @ TO_USD).T.ravel().tolist()))
    prim.CreateFocalLengthAttr(focal_length)
    prim.CreateHorizontalApertureAttr(WIDTH)
    prim.CreateVerticalApertureAttr(camera.height * along)
    prim.CreateHorizontalApertureOffsetAttr((camera.width / 2 - lens[0, 2]) * across)
    prim.CreateVerticalApertureOffsetAttr((lens[1, 2] - camera.height / 2) * along)
    prim.CreateClippingRangeAttr(Gf.Vec2f(*CLIPPING))
