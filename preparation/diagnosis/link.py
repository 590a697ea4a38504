"""Link: what the matches of two images have in common."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from gsfw.preparation.diagnosis.pair_motion import only_turned
from gsfw.preparation.feature_database import image_numbers
from gsfw.preparation.image_set import ImageSet

if TYPE_CHECKING:
    from pycolmap import Database, TwoViewGeometry

LEAST, JOINED = 15, 30
"""Verified matches: COLMAP drops pairs with fewer than the first (``min_num_matches``), and the
second joins two images, as one is placed by so many points (``abs_pose_min_num_inliers``). In
between may be chance, as on the squares of a board: 19 photos of plush that are too far apart fall
into 11, 5 and 3 by it, and those are the models that COLMAP makes of them."""
SAME_VIEW = 5e-4
"""Median distance of matches, in longer sides of an image, below which two images show one view:
half a pixel of 1000, which is about how precisely features are found."""
MOVED = 0.03
"""Shift, in longer sides, from which a pair tells a turn from a step sideways."""
SAMPLED = 200
"""Number of pairs that are searched for matches that stay in place while the view moves."""


@dataclass(frozen=True)
class Link:
    """Measurements of a pair of images."""

    first: str
    second: str
    matches: int
    """Features that look alike."""
    verified: int = 0
    """Matches that one motion of a camera explains, all at once."""
    shift: float = 0.0
    """Median distance between the two places of a verified match, in longer sides of an image."""
    flat: bool = False
    """True if a homography explains them: all lie in one plane, or the camera only turned."""
    is_turn: bool = False
    """True if the view has moved, and the camera only turned."""

    @property
    def joins(self) -> bool:
        """True if that is no chance."""
        return self.verified >= JOINED

    @property
    def is_still(self) -> bool:
        """True if the view is the same in both."""
        return self.shift < SAME_VIEW

    def other(self, name: str) -> str:
        """The image that is not ``name``."""
        return self.second if name == self.first else self.first


class FeaturePlaces:
    """Positions of features, in longer sides of their images; read on first use."""

    def __init__(self, database: Database, images: ImageSet) -> None:
        self._database, self._numbers = database, image_numbers(images)
        self._sizes = {p.name: (p.header.width, p.header.height) for p in images.images}
        self._known: dict[str, Float[np.ndarray, "n 2"]] = {}

    def of(self, name: str) -> Float[np.ndarray, "n 2"]:
        """Positions of the features of an image."""
        if name not in self._known:
            keypoints = self._database.read_keypoints(self._numbers[name])
            self._known[name] = np.asarray(keypoints)[:, :2] / max(self._sizes[name])
        return self._known[name]

    def shifts(self, first: str, second: str, matches: np.ndarray) -> Float[np.ndarray, " m"]:
        """Distances between the two positions of each match."""
        ours, theirs = self.of(first)[matches[:, 0]], self.of(second)[matches[:, 1]]
        return np.asarray(np.linalg.norm(ours - theirs, axis=1))

    def show_turn(self, first: str, second: str, motion: TwoViewGeometry) -> bool:
        """True if the verified matches show that the camera turned, and did not move."""
        ours, theirs = (self._to_pixels(name) for name in (first, second))
        pairs = motion.inlier_matches
        return only_turned(
            self.of(first)[pairs[:, 0]] - ours[:2, 2] / ours[0, 0],
            self.of(second)[pairs[:, 1]] - theirs[:2, 2] / theirs[0, 0],
            None if motion.H is None else np.linalg.inv(theirs) @ motion.H @ ours,
        )

    def _to_pixels(self, name: str) -> Float[np.ndarray, "3 3"]:
        """The matrix from offsets from an image's centre, in longer sides, to pixels."""
        width, height = self._sizes[name]
        side = max(width, height)
        return np.array([[side, 0, width / 2], [0, side, height / 2], [0, 0, 1]])

    def read_shifts(self, link: Link) -> Float[np.ndarray, " m"]:
        """The same of all matches of a pair, verified or not."""
        numbers = self._numbers[link.first], self._numbers[link.second]
        return self.shifts(link.first, link.second, self._database.read_matches(*numbers))

    def still(self, links: Sequence[Link]) -> float:
        """The median, over some pairs whose view moves, of the part of matches that does not.

        Matches that no motion explains count as well: what stands still is among them.
        """
        moving = [link for link in links if link.joins and link.shift > 10 * SAME_VIEW]
        chosen = np.unique(np.linspace(0, len(moving) - 1, min(len(moving), SAMPLED)).astype(int))
        shares = [float((self.read_shifts(moving[i]) < SAME_VIEW).mean()) for i in chosen]
        return float(np.median(shares)) if shares else 0.0
