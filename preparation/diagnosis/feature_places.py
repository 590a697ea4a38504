"""FeaturePlaces: where features are in their pictures, and which of them never move."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from gsfw.preparation.diagnosis.link import SAME_VIEW, Link
from gsfw.preparation.feature_database import picture_numbers
from gsfw.preparation.picture_set import PictureSet

if TYPE_CHECKING:
    from pycolmap import Database

SAMPLED = 200
"""So many pairs are looked at for what stays in place while everything else moves."""


class FeaturePlaces:
    """Where features are, in longer sides of their pictures; read when asked for."""

    def __init__(self, database: Database, pictures: PictureSet) -> None:
        self._database, self._numbers = database, picture_numbers(pictures)
        self._sides = {p.name: max(p.header.width, p.header.height) for p in pictures.pictures}
        self._known: dict[str, Float[np.ndarray, "n 2"]] = {}

    def of(self, name: str) -> Float[np.ndarray, "n 2"]:
        """Of the features of a picture."""
        if name not in self._known:
            keypoints = self._database.read_keypoints(self._numbers[name])
            self._known[name] = np.asarray(keypoints)[:, :2] / self._sides[name]
        return self._known[name]

    def shifts(self, first: str, second: str, matches: np.ndarray) -> Float[np.ndarray, " m"]:
        """How far apart the two places of matches are."""
        ours, theirs = self.of(first)[matches[:, 0]], self.of(second)[matches[:, 1]]
        return np.asarray(np.linalg.norm(ours - theirs, axis=1))

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
