"""TimeOrder: whether images of a standing camera follow each other in the order of their times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from gsfw.core.datamanager import DataManager
from gsfw.core.errors import DataError
from gsfw.preparation.check.small_images import load_small, size_at_most
from gsfw.preparation.check.viewpoints import Viewpoints

IMAGES = 24
"""Images of one camera that are compared, at times that follow each other."""
FEWEST = 8
"""Smallest number of images that is judged: some order of few images is always smooth."""
SIDE = 96
"""Longer side of the images when they are compared: what moves by a pixel hardly counts."""
JUMPS, SMOOTH = 0.85, 0.65
"""Difference of neighbours, in parts of that of any two images, from which on times are out of
order, and up to which another order is smooth: 0.50 to 0.59 and 0.42 to 0.46 for garden_robot_mv,
0.95 to 0.98 and the same with its times shuffled. Fire and water jump in every order."""


@dataclass(frozen=True)
class TimeOrder:
    """Differences between images that follow each other, in parts of that of any two."""

    given: float
    """In the order of their times."""
    best: float
    """In the smoothest order that is found by always going to the most similar image."""

    @property
    def shuffled(self) -> bool:
        """True if the times surely belong to other images."""
        return self.given >= JUMPS and self.best <= SMOOTH

    @staticmethod
    def of(data: DataManager, viewpoints: Viewpoints) -> TimeOrder | None:
        """Order of the camera with most images; ``None`` if none stands still or one is damaged."""
        if viewpoints.times is None or not viewpoints.stand_still:
            return None
        counts = np.bincount(viewpoints.place_of)
        views = np.flatnonzero(viewpoints.place_of == counts.argmax())
        views = views[np.argsort(viewpoints.times[views], kind="stable")][:IMAGES]
        if len(views) < FEWEST:
            return None
        try:
            images = np.stack([_small(data, viewpoints, int(view)) for view in views])
        except DataError:
            return None
        apart = np.sqrt(np.square(images[:, None] - images).mean(2))
        usual = float(apart[np.triu_indices(len(apart), 1)].mean())
        if usual <= 0:
            return None
        given = float(np.diagonal(apart, 1).mean())
        return TimeOrder(given / usual, _smoothest(apart) / usual)


def _small(data: DataManager, viewpoints: Viewpoints, view: int) -> Float[np.ndarray, " n"]:
    width, height = viewpoints.sizes[view].tolist()
    size = size_at_most(width, height, SIDE)
    small = load_small(data, viewpoints.splits[view], viewpoints.numbers[view], *size)
    return small.target(torch.ones(3))[0].double().numpy().ravel()


def _smoothest(apart: Float[np.ndarray, "n n"]) -> float:
    """Mean difference along the best path that always goes to the nearest image not yet there."""
    best = np.inf
    for start in range(len(apart)):
        left = np.ones(len(apart), bool)
        left[start] = False
        current, length = start, 0.0
        while left.any():
            step = np.where(left, apart[current], np.inf)
            current = int(step.argmin())
            length += float(step[current])
            left[current] = False
        best = min(best, length / (len(apart) - 1))
    return best
