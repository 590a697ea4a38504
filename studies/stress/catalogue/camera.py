"""Camera: focal lengths and principal points that no lens has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from gsfw.core.cameras import Cameras
from gsfw.studies.stress.case import Change
from gsfw.studies.stress.catalogue.depth import moved
from gsfw.studies.stress.catalogue.shape import FLAT, scaled
from gsfw.studies.stress.catalogue.variants import camera_cases


def camera_with(
    focal: float, principal: float = 0.5, aspect: float = 1.0
) -> Callable[[Cameras], Cameras]:
    """A camera with this focal length in pixels, and a centre in parts of the image."""

    def change(camera: Cameras) -> Cameras:
        k = camera.intrinsics.clone()
        k[0, 0, 0], k[0, 1, 1] = focal, focal * aspect
        k[0, :2, 2] = k.new_tensor([camera.width, camera.height]) * principal
        return replace(camera, intrinsics=k)

    return change


CAMERAS: dict[str, Callable[[Cameras], Cameras]] = {
    "camera/focal-1e-2": camera_with(1e-2),
    "camera/focal-1e6": camera_with(1e6),
    "camera/focal-1e30": camera_with(1e30),
    "camera/field-of-view-179": camera_with(0.09),
    "camera/principal-point-outside": camera_with(20.0, -3.0),
    "camera/principal-point-far-outside": camera_with(20.0, 1e6),
    "camera/pixels-not-square": camera_with(24.0, aspect=30.0),
}

SPLATS: dict[str, Change] = {
    "": lambda splats: splats,
    "-scales-1e6": scaled(1e6, 1e6, 1e6),
    "-around-the-camera": moved(-1.0, 0.0, 1e-9, 1e-6, 1e-3, 0.009999, 0.01, 0.02),
}

NEAR = "splats almost at the camera are magnified until they are flat, as very large ones are"
LONG = "whether depth squared still fits beside this focal length decides what is drawn"

REASONS = {
    **{f"{name}-scales-1e6": FLAT for name in CAMERAS},
    **{f"{name}-around-the-camera": NEAR for name in CAMERAS},
    "camera/focal-1e30-around-the-camera": LONG,
}

CAMERA = camera_cases(CAMERAS, SPLATS, REASONS)
"""All cases of this section."""
