"""Observations: which image of a model sees which point where, as arrays."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64, Int64

if TYPE_CHECKING:
    from pycolmap import Reconstruction

Integers = Int64[np.ndarray, " o"]
"""One for each observation."""
COMMON_POINTS = 30
"""Two images that share fewer points do not fix each other's poses: COLMAP's least number for an
image that it adds. In three global mappings of 12 and 24 of the fox photos that went wrong, this
found the wrong ones in two; in one, wrong groups shared more."""


@dataclass(frozen=True)
class Observations:
    """Arrays of o observations, ordered by their points."""

    images: Integers
    """Positions in ``image_ids``."""
    points: Integers
    """Positions in ``positions``."""
    features: Integers
    """Numbers of the features in their images."""
    image_ids: Int64[np.ndarray, " r"]
    """COLMAP's ids of the registered images, ascending."""
    positions: Float64[np.ndarray, "p 3"]
    """Positions of the points, in the model's units."""

    @staticmethod
    def of(model: Reconstruction) -> Observations:
        """Read a model."""
        seen: list[tuple[int, int]] = []
        positions, lengths = [], []
        for point in model.points3D.values():
            elements = point.track.elements
            positions.append(point.xyz)
            lengths.append(len(elements))
            seen += [(element.image_id, element.point2D_idx) for element in elements]
        table = np.array(seen, dtype=np.int64).reshape(-1, 2)
        image_ids = np.array(sorted(model.reg_image_ids()), dtype=np.int64)
        return Observations(
            images=np.searchsorted(image_ids, table[:, 0]).astype(np.int64),
            points=np.repeat(np.arange(len(positions), dtype=np.int64), lengths),
            features=table[:, 1],
            image_ids=image_ids,
            positions=np.array(positions, dtype=np.float64).reshape(-1, 3),
        )

    @cached_property
    def lengths(self) -> Int64[np.ndarray, " p"]:
        """Number of images that see each point."""
        return np.bincount(self.points, minlength=len(self.positions)).astype(np.int64)

    @cached_property
    def counts(self) -> Int64[np.ndarray, " r"]:
        """Number of points that each image sees."""
        return np.bincount(self.images, minlength=len(self.image_ids)).astype(np.int64)

    def by_frame(self, model: Reconstruction) -> Observations:
        """The same with frames, as of the views of a panorama, for images: by their first ones."""
        frames = [model.image(number).frame_id for number in self.image_ids.tolist()]
        _, first, positions = np.unique(frames, return_index=True, return_inverse=True)
        if len(first) == len(frames):
            return self
        return replace(
            self,
            images=positions.astype(np.int64)[self.images],
            image_ids=self.image_ids[first],
        )

    def by_image(self) -> Iterator[tuple[int, np.ndarray]]:
        """COLMAP's id of each image, and which observations are its own."""
        order = np.argsort(self.images, kind="stable")
        parts = np.split(order, np.cumsum(self.counts))[:-1]
        yield from zip(self.image_ids.tolist(), parts, strict=True)

    def features_of(self, image_id: int) -> Integers:
        """Numbers of the features of an image that see a point."""
        return self.features[self.image_ids[self.images] == image_id]

    def points_of(self, image_id: int) -> Float64[np.ndarray, "f 3"]:
        """Positions of the points that these see, in the same order."""
        return self.positions[self.points[self.image_ids[self.images] == image_id]]

    def seen_by(self, image_ids: set[int]) -> np.ndarray:
        """Booleans: True for each point that one of these images sees."""
        chosen = np.isin(self.image_ids, list(image_ids))
        return np.bincount(self.points[chosen[self.images]], minlength=len(self.positions)) > 0


def held_together(seen: Observations) -> set[int]:
    """COLMAP's ids of the largest group of images that hold each other, directly or not."""
    from scipy import sparse

    size = (len(seen.image_ids), len(seen.positions))
    sees = sparse.csr_array((np.ones(len(seen.points)), (seen.images, seen.points)), size)
    sees.data[:] = 1  # Neighbouring views of a panorama may see a point twice.
    holds = (sees @ sees.T) >= COMMON_POINTS
    _, groups = sparse.csgraph.connected_components(holds, directed=False)
    if not len(groups):
        return set()
    return set(seen.image_ids[groups == np.bincount(groups).argmax()].tolist())


def cut_loose(model: Reconstruction) -> int:
    """Take the poses from images that the largest group does not hold, and say how many."""
    held = held_together(Observations.of(model).by_frame(model))
    frames = {model.image(number).frame_id for number in held}
    loose = [n for n in model.reg_image_ids() if model.image(n).frame_id not in frames]
    for frame in sorted({model.image(number).frame_id for number in loose}):
        model.deregister_frame(frame)
    model.update_point_3d_errors()
    return len(loose)
