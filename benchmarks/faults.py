"""Faults that captures are met with, made on purpose from sound ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from made_capture import OPENGL, MadeCapture

SEED = 18


def poses_exchanged(capture: MadeCapture) -> MadeCapture:
    """Two images far apart have each other's pose."""
    one, other = len(capture) // 5, 3 * len(capture) // 5
    order = list(range(len(capture)))
    order[one], order[other] = other, one
    return capture.reordered(order)


def poses_inverted(capture: MadeCapture) -> MadeCapture:
    """World to camera where the file should say camera to world."""
    return replace(capture, poses=OPENGL @ np.linalg.inv(capture.poses) @ OPENGL)


def axes_mixed(capture: MadeCapture) -> MadeCapture:
    """OpenCV's axes of the cameras where the file should have OpenGL's."""
    return replace(capture, poses=OPENGL @ capture.poses)


def images_flipped(capture: MadeCapture) -> MadeCapture:
    """Images that are mirrored left to right, as front cameras of phones write them."""
    return replace(capture, images=tuple(image[:, ::-1] for image in capture.images))


def world_left_handed(capture: MadeCapture) -> MadeCapture:
    """Poses of a tool whose world is left-handed."""
    return replace(capture, mirrored=True, points=capture.points * [1.0, -1.0, 1.0])


def focal_length_wrong(capture: MadeCapture) -> MadeCapture:
    """Focal lengths 1.5 times too long."""
    return replace(capture, pinholes=capture.pinholes * [1.5, 1.5, 1.0, 1.0])


def focal_lengths_spread(capture: MadeCapture) -> MadeCapture:
    """A focal length for each image, as a calibration that failed has found them."""
    factors = np.random.default_rng(SEED).uniform(0.7, 1.4, (len(capture), 1))
    pinholes = capture.pinholes.copy()
    pinholes[:, :2] *= factors
    return replace(capture, pinholes=pinholes)


def masks_named_otherwise(capture: MadeCapture) -> MadeCapture:
    """Masks that are numbered, while images have names."""
    masks = []
    for number, image in enumerate(capture.images):
        inside = np.zeros(image.shape[:2], np.uint8)
        inside[inside.shape[0] // 4 :] = 255
        masks.append((f"segmentation{number + 1}.png", inside))
    return replace(capture, masks=masks)


def images_shuffled(capture: MadeCapture) -> MadeCapture:
    """Images in another order than their poses."""
    return capture.reordered(np.random.default_rng(SEED).permutation(len(capture)).tolist())


def two_scenes(capture: MadeCapture, other: MadeCapture) -> MadeCapture:
    """Two places in one model, each true in itself: both lie at one spot, seen from one side."""
    half = max(len(other) // 2, 1)
    moved = other.poses[:half] @ np.linalg.inv(_stand(other.poses[:half])) @ _stand(capture.poses)
    return replace(
        capture,
        names=(*capture.names, *(f"zz_{name}" for name in other.names[:half])),
        images=(*capture.images, *other.images[:half]),
        poses=np.concatenate([capture.poses, moved]),
        pinholes=np.concatenate([capture.pinholes, other.pinholes[:half]]),
    )


def _stand(poses: np.ndarray) -> np.ndarray:
    """World to a frame at the mean of the cameras, which looks as the middle one does."""
    stand = np.eye(4)
    centers = -np.einsum("vji,vj->vi", poses[:, :3, :3], poses[:, :3, 3])
    stand[:3, :3] = poses[len(poses) // 2, :3, :3]
    stand[:3, 3] = -stand[:3, :3] @ centers.mean(0)
    return stand


def unlit(capture: MadeCapture) -> MadeCapture:
    """A third of the images was taken in the dark."""
    return replace(
        capture,
        images=tuple(
            (image * 0.03).astype(np.uint8) if number % 3 == 1 else image
            for number, image in enumerate(capture.images)
        ),
    )


def camera_turned(capture: MadeCapture, degrees: float = 40.0) -> MadeCapture:
    """One camera looks elsewhere, turned to the side."""
    angle = math.radians(degrees)
    turn = np.eye(4)
    turn[[0, 0, 2, 2], [0, 2, 0, 2]] = (
        math.cos(angle), math.sin(angle), -math.sin(angle), math.cos(angle),
    )  # fmt: skip
    poses = capture.poses.copy()
    poses[len(capture) // 2] = turn @ poses[len(capture) // 2]
    return replace(capture, poses=poses)


def points_of_another_scale(capture: MadeCapture) -> MadeCapture:
    """Points in a unit of which the cameras' has ten."""
    return replace(capture, points=10 * capture.points)


def rolling_shutter(capture: MadeCapture, pixels: float = 12.0) -> MadeCapture:
    """Rows that were exposed one after another while the camera was swung to the side.

    The last row lies up to so many pixels beside where the first one would have it.
    """
    generator = np.random.default_rng(SEED)
    images = []
    for image in capture.images:
        height, width = image.shape[:2]
        swing = pixels * generator.choice((-1, 1)) * generator.uniform(0.5, 1)
        shifts = swing * (np.arange(height) / height - 0.5)
        columns = np.clip(np.arange(width) + np.rint(shifts)[:, None], 0, width - 1).astype(int)
        images.append(image[np.arange(height)[:, None], columns])
    return replace(capture, images=tuple(images))


def turntable(capture: MadeCapture, behind: np.ndarray) -> MadeCapture:
    """The object turned before a camera that stood still, and the poses are those of the object.

    Args:
        capture: with alpha.
        behind: the background, of any size.
    """
    images = []
    for image in capture.images:
        height, width = image.shape[:2]
        rows = np.linspace(0, behind.shape[0] - 1, height).astype(int)
        columns = np.linspace(0, behind.shape[1] - 1, width).astype(int)
        alpha = image[..., 3:] / 255
        still = behind[rows[:, None], columns, :3]
        images.append((image[..., :3] * alpha + still * (1 - alpha)).round().astype(np.uint8))
    return replace(capture, images=tuple(images))


def times_shuffled(capture: MadeCapture) -> MadeCapture:
    """Each camera's images in another order than their times."""
    assert capture.times is not None
    distinct = np.unique(capture.times)
    mixed = np.random.default_rng(SEED).permutation(distinct)
    return replace(capture, times=mixed[np.searchsorted(distinct, capture.times)])
