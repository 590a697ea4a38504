"""Lenses of every model, and images in which known rays show as round spots."""

import numpy as np

from gsfw.datamanagers.lens import ONE_FOCAL_LENGTH, Lens

WIDTH, HEIGHT = 240, 180
FOCAL = (170.0, 174.0)
CENTER = (117.0, 93.0)
SPREAD = 5.0
"""Pixels; of a spot, once it is undistorted."""
BRIGHTNESS = (250, 231, 217)
"""Of spots; each channel is rounded differently, so that rounding cancels out in their mean."""

DISTORTIONS = {
    "SIMPLE_RADIAL": (-0.1,),
    "RADIAL": (-0.2, 0.05),
    "OPENCV": (-0.12, 0.03, 0.004, -0.003),
    "OPENCV_FISHEYE": (0.03, -0.01, 0.004, -0.001),
    "FULL_OPENCV": (0.1, 0.02, 0.002, -0.003, 0.004, 0.2, 0.03, 0.002),
    "FOV": (0.9,),
    "SIMPLE_RADIAL_FISHEYE": (0.03,),
    "RADIAL_FISHEYE": (-0.02, 0.004),
    "THIN_PRISM_FISHEYE": (0.02, -0.01, 0.002, 0.003, 0.001, -0.001, 0.003, -0.002),
    "RAD_TAN_THIN_PRISM_FISHEYE": (
        *(0.02, -0.01, 0.001, 0.0002, 0.0, 0.0),
        *(0.002, -0.001, 0.001, 0.0, -0.001, 0.0),
    ),
    "SIMPLE_DIVISION": (-0.15,),
    "DIVISION": (-0.15,),
    "SIMPLE_FISHEYE": (),
    "FISHEYE": (),
    "EUCM": (0.55, 1.1),
}
"""Of every model that is not a pinhole, as strong as lenses are."""

PINHOLES = {"SIMPLE_PINHOLE": (), "PINHOLE": ()}


def lens(model: str, distortion: tuple | None = None) -> Lens:
    """A lens of a model; its one or two focal lengths are those of the models that have so many."""
    values = DISTORTIONS[model] if distortion is None else distortion
    fx, fy = (FOCAL[0], FOCAL[0]) if model in ONE_FOCAL_LENGTH else FOCAL
    return Lens(fx, fy, *CENTER, WIDTH, HEIGHT, "camera 1", model, values)


def parameters(camera: Lens) -> tuple[float, ...]:
    """All of them, as COLMAP's files have them."""
    focal = (camera.fx,) if camera.model in ONE_FOCAL_LENGTH else (camera.fx, camera.fy)
    return (*focal, camera.cx, camera.cy, *camera.distortion)


def slopes_on_grid() -> np.ndarray:
    """[20, 2]: rays at some distance from one another, off the middles of pixels."""
    x, y = np.meshgrid([-0.5, -0.27, -0.013, 0.241, 0.5], [-0.38, -0.12, 0.131, 0.37])
    return np.stack([x.ravel(), y.ravel()], axis=1)


def spots(camera: Lens, target: Lens, slopes: np.ndarray) -> np.ndarray:
    """What the camera sees where each ray shows as a spot that is round in the target's image."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    seen = target.project(camera.unproject(np.stack([x.ravel(), y.ravel()], axis=1)))
    offsets = np.nan_to_num(seen[:, None] - target.project(slopes), nan=1e6)
    values = np.exp(-(offsets**2).sum(-1) / (2 * SPREAD**2)).max(axis=1)
    colors = np.rint(values[:, None] * BRIGHTNESS).astype(np.uint8)
    return colors.reshape(camera.height, camera.width, 3)


def spot_errors(image: np.ndarray, expected: np.ndarray, spread: float = SPREAD) -> np.ndarray:
    """[m, 2]: pixels between spots and where they are expected.

    Under a weight as wide as a spot, its centre of gravity moves half as far as the spot.
    """
    values = image.astype(np.float64).mean(axis=2)
    x, y = np.arange(values.shape[1]) + 0.5, np.arange(values.shape[0]) + 0.5
    errors = []
    for center in expected:
        across, down = x - center[0], y[:, None] - center[1]
        weighted = values * np.exp(-(across**2 + down**2) / (2 * spread**2))
        moments = np.array([(weighted * across).sum(), (weighted * down).sum()])
        errors.append(2 * moments / weighted.sum())
    return np.array(errors)
