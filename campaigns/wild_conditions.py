"""Conditions that no training is made for: wrong rates, cameras, images, points and times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from wild_captures import HEIGHT, WIDTH, Capture

Damage = Callable[[Capture, np.random.Generator], Capture]


@dataclass(frozen=True)
class Condition:
    """One thing that is wrong with a run."""

    name: str
    """Description in words: "learning rates x100"."""
    damage: Damage = lambda capture, _: capture
    """Changes the capture."""
    rates: float = 1.0
    """Factor of all learning rates."""
    settings: Sequence[str] = ()
    """Further settings of the run."""
    is_of_time: bool = False
    """True if only methods of moving scenes can show it."""


def _poses(change: Callable[[NDArray[np.float64]], object]) -> Damage:
    """Damage to the camera of the first view: ``change`` edits its matrix."""

    def damage(capture: Capture, _: np.random.Generator) -> Capture:
        poses = capture.poses.copy()
        change(poses[0])
        return replace(capture, poses=poses)

    return damage


def _points(change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Damage:
    """Damage to all points; colours of points that are left out go with them."""

    def damage(capture: Capture, _: np.random.Generator) -> Capture:
        points = change(capture.points.copy())
        return replace(capture, points=points, colors=capture.colors[: len(points)])

    return damage


def _images(change: Callable[[int, NDArray[np.generic]], NDArray[np.generic]]) -> Damage:
    """Damage to the images, by number."""

    def damage(capture: Capture, _: np.random.Generator) -> Capture:
        images = tuple(change(view, image) for view, image in enumerate(capture.images))
        return replace(capture, images=images)

    return damage


def _scaled(factor: float, shift: float = 0.0) -> Damage:
    """The world in another unit, and far from its origin."""

    def damage(capture: Capture, _: np.random.Generator) -> Capture:
        poses = capture.poses.copy()
        poses[:, :3, 3] = poses[:, :3, 3] * factor + shift
        return replace(capture, poses=poses, points=capture.points * factor + shift)

    return damage


def _shuffled(capture: Capture, generator: np.random.Generator) -> Capture:
    return replace(capture, poses=generator.permutation(capture.poses))


def _exposed(factor: float) -> Callable[[int, NDArray[np.generic]], NDArray[np.generic]]:
    """Every second image with an exposure of ``factor``, clipped as a camera does."""
    return lambda view, image: (image * factor).clip(0, 255).astype(np.uint8) if view % 2 else image


def _one(value: int) -> Callable[[int, NDArray[np.generic]], NDArray[np.generic]]:
    """The first image in one grey."""
    return lambda view, image: np.full_like(image, value) if view == 0 else image


def _all(value: int, channels: int = 3) -> Callable[[int, NDArray[np.generic]], NDArray[np.uint8]]:
    return lambda _, image: np.full((*image.shape[:2], channels), value, np.uint8)


def _floats(value: float) -> Callable[[int, NDArray[np.generic]], NDArray[np.generic]]:
    """The first image of floating-point numbers that are all ``value``."""
    return lambda view, image: np.full((HEIGHT, WIDTH), value, np.float32) if view == 0 else image


def _with_times(rule: Callable[[float], float]) -> Damage:
    return lambda capture, _: replace(capture, times=tuple(map(rule, capture.times or ())))


def _focal(length: float) -> Damage:
    return lambda capture, _: replace(capture, focal=(length, length))


def _at_center(capture: Capture, _: np.random.Generator) -> Capture:
    poses = capture.poses.copy()
    poses[:, :3, 3] = 0
    return replace(capture, poses=poses)


def _turned_away(capture: Capture, _: np.random.Generator) -> Capture:
    return replace(capture, poses=capture.poses @ np.diag([1.0, -1.0, -1.0, 1.0]))


def _strips(height: int, width: int) -> Damage:
    """Images that are cut to a corner."""
    return _images(lambda _, image: np.ascontiguousarray(image[:height, :width]))


def _outlier(points: NDArray[np.float64]) -> NDArray[np.float64]:
    points[0] = 1e12
    return points


CONDITIONS: tuple[Condition, ...] = (
    Condition("nothing is wrong"),
    *(Condition(f"learning rates x{factor:,}", rates=factor) for factor in (10, 100, 1000, 10**6)),
    Condition("learning rates of zero", rates=0.0),
    Condition("poses shuffled among the views", _shuffled),
    Condition("cameras that look away", _turned_away),
    Condition("all cameras at one place", _at_center),
    Condition("a camera matrix of zeros", _poses(lambda pose: pose.fill(0.0))),
    Condition("a camera matrix of NaN", _poses(lambda pose: pose.fill(np.nan))),
    Condition("a camera at infinity", _poses(lambda pose: pose[:3, 3].fill(np.inf))),
    Condition("a camera 1e12 away", _poses(lambda pose: pose[:3, 3].fill(1e12))),
    Condition("a mirrored camera", _poses(lambda pose: np.negative(pose[:3, 0], pose[:3, 0]))),
    Condition("a flattened camera", _poses(lambda pose: np.multiply(pose[0], 1e-9, pose[0]))),
    *(Condition(f"a focal length of {length:g} pixels", _focal(length)) for length in (1e-6, 1e9)),
    Condition("a focal length of zero", _focal(0.0)),
    Condition("a negative focal length", _focal(-40.0)),
    Condition("a focal length of NaN", _focal(np.nan)),
    Condition("one black image", _images(_one(0))),
    Condition("one white image", _images(_one(255))),
    Condition("all images black", _images(_all(0))),
    Condition("all images white, as the background", _images(_all(255))),
    Condition("all images grey", _images(_all(128))),
    Condition("all images transparent", _images(_all(0, 4))),
    Condition("an image of NaN (floating-point TIFF)", _images(_floats(np.nan))),
    Condition("an image of infinity (floating-point TIFF)", _images(_floats(np.inf))),
    Condition("exposures of 100x in every second image", _images(_exposed(100.0))),
    Condition("exposures of 1/100 in every second image", _images(_exposed(0.01))),
    Condition("exposures of 100x, corrected", _images(_exposed(100.0)), 1.0, ("exposure=true",)),
    Condition("images of one pixel", _strips(1, 1)),
    Condition("images of one row", _strips(1, WIDTH)),
    Condition("images of 5x5 pixels", _strips(5, 5)),
    Condition("all points at one place", _points(lambda points: points * 0 + points[:1])),
    Condition("all points in a line", _points(lambda points: points * [1, 0, 0])),
    Condition("all points in a plane", _points(lambda points: points * [1, 1, 0])),
    Condition("one point", _points(lambda points: points[:1])),
    Condition("two points", _points(lambda points: points[:2])),
    Condition("no points", _points(lambda points: points[:0])),
    Condition("a point 1e12 away", _points(_outlier)),
    Condition("a point of NaN", _points(lambda p: np.where(p < p.max(), p, np.nan))),
    Condition("points 1e6 times as far as the cameras", _points(lambda points: points * 1e6)),
    Condition("one view", lambda capture, _: capture.first(1)),
    Condition("two views, of one time", lambda capture, _: capture.first(2)),
    Condition("a step of more views than there are", settings=("sampler.views_per_step=64",)),
    *(Condition(f"a world {factor:g} as large", _scaled(factor)) for factor in (1e-6, 1e6)),
    *(Condition(f"a world {factor:g} as large", _scaled(factor)) for factor in (1e-30, 1e30)),
    Condition("a world 1e7 from its origin", _scaled(1.0, 1e7)),
    Condition("all times equal", _with_times(lambda _: 0.5), is_of_time=True),
    Condition("a time of NaN", _with_times(lambda time: time or np.nan), is_of_time=True),
    Condition("times of 1e12 seconds", _with_times(lambda time: 1e12 * time), is_of_time=True),
    Condition("times of 1e-12 seconds", _with_times(lambda time: 1e-12 * time), is_of_time=True),
    Condition("negative times", _with_times(lambda time: -time), is_of_time=True),
)  # fmt: skip
