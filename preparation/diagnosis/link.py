"""Link: what the matches of two pictures have in common."""

from __future__ import annotations

from dataclasses import dataclass

LEAST, JOINED = 15, 30
"""Verified matches: COLMAP drops pairs with fewer than the first (``min_num_matches``), and the
second joins two pictures, as one is placed by so many points (``abs_pose_min_num_inliers``). In
between may be chance, as on the squares of a board: 19 photos of plush that are too far apart fall
into 11, 5 and 3 by it, and those are the models that COLMAP makes of them."""
SAME_VIEW = 5e-4
"""Median distance of matches, in longer sides of a picture, below which two pictures show one view:
half a pixel of 1000, which is about how precisely features are found."""
TURN, MOVED = 0.01, 0.03
"""``Link.turn`` of a camera that only turned, for a shift (in longer sides) that is large enough to
tell: rendered turns have up to 0.0011, and 7 of 191 pairs of fox and plush less than 0.01.
"""


@dataclass(frozen=True)
class Link:
    """What two pictures have in common."""

    first: str
    second: str
    matches: int
    """Features that look alike."""
    verified: int = 0
    """Matches that one motion of a camera explains, all at once."""
    shift: float = 0.0
    """Median distance between the two places of a verified match, in longer sides of a picture."""
    flat: bool = False
    """Whether a homography explains them: all lie in one plane, or the camera only turned."""
    turn: float = 1.0
    """How far that homography is from one of a camera that only turned, where 0 is none at all."""

    @property
    def joins(self) -> bool:
        """Whether that is no chance."""
        return self.verified >= JOINED

    @property
    def is_turn(self) -> bool:
        """Whether the view has moved, and the camera only turned."""
        return self.flat and self.turn < TURN and self.shift > MOVED

    @property
    def is_still(self) -> bool:
        """Whether the view is the same in both."""
        return self.shift < SAME_VIEW

    def other(self, name: str) -> str:
        """The picture that is not ``name``."""
        return self.second if name == self.first else self.first
