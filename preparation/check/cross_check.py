"""CrossCheck: what the images say of their cameras, found from matches between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from gsfw.core.datamanager import DataManager
from gsfw.preparation.check.contradictions import Contradictions
from gsfw.preparation.check.focal_scale import focal_factor
from gsfw.preparation.check.image_sample import ImageSample
from gsfw.preparation.check.pose_agreement import Rig
from gsfw.preparation.check.pose_conventions import Reading, better_reading
from gsfw.preparation.check.rolling_shutter import row_shear
from gsfw.preparation.check.scene_groups import separate_group
from gsfw.preparation.check.track_places import off_tracks
from gsfw.preparation.check.view_matches import ViewMatches
from gsfw.preparation.check.viewpoints import Viewpoints

UNMOVED = 0.3
"""Part of the matches between turned cameras at the same pixel from which on a background is
said to turn with the camera: 0.00 to 0.02 in the shared captures, whose cameras moved."""
APART = 20.0
"""Degrees between the axes of two cameras, beyond which nothing stays at its pixel."""
FEWEST_PAIRS = 10
"""Pairs of such images below which nothing is said."""


@dataclass(frozen=True)
class CrossCheck:
    """Findings of matches; of several faults only the first is sought, as it explains the rest."""

    matches: ViewMatches
    rig: Rig
    turntable: float | None = None
    """Part of the matches that stays at its pixel, if the background turns with the cameras."""
    reading: Reading | None = None
    """The right reading of the poses, if another one than theirs."""
    focal_factor: float | None = None
    """By which all focal lengths have to be multiplied, if that is sure."""
    contradictions: Contradictions | None = None
    """``None`` as well where things move, which contradict their poses rightly."""
    other_scene: tuple[int, ...] = ()
    """Views that show another place than the rest."""
    off_tracks: tuple[int, ...] = ()
    """Views that do not show the points that a reconstruction matched in them."""
    row_shear: float | None = None
    """Shear of an image by a rolling shutter, in its longer side, if that is sure."""

    @staticmethod
    def of(data: DataManager, viewpoints: Viewpoints, sample: ImageSample) -> CrossCheck:
        """Match the sampled images, and compare with their cameras."""
        scene = data.scene
        matches, rig = ViewMatches.of(viewpoints, sample), Rig.of(viewpoints, scene)
        found = CrossCheck(matches, rig)
        share = None if scene.has_alpha else _unmoved(viewpoints, matches, sample)
        if share is not None and share > UNMOVED:
            return CrossCheck(matches, rig, turntable=share)
        reading = better_reading(matches, rig)
        if reading is not None:
            return CrossCheck(matches, rig, reading=reading)
        factor = focal_factor(matches, rig)
        if factor is not None:
            return CrossCheck(matches, rig, focal_factor=factor)
        if scene.num_times < 2:
            return CrossCheck(
                matches,
                rig,
                contradictions=Contradictions.of(matches, rig),
                other_scene=separate_group(matches, viewpoints),
                off_tracks=off_tracks(data, viewpoints),
                row_shear=row_shear(matches, rig),
            )
        return found

    @property
    def cameras_wrong(self) -> bool:
        """True if hardly any camera is right, so that nothing else can be told from them."""
        most = self.contradictions is not None and self.contradictions.most
        return self.reading is not None or self.focal_factor is not None or most

    @property
    def misplaced(self) -> Int[np.ndarray, " k"]:
        """Views whose cameras look elsewhere than their images."""
        found = () if self.contradictions is None else self.contradictions.views
        return np.unique([*found, *self.off_tracks]).astype(np.int64)


def _unmoved(viewpoints: Viewpoints, matches: ViewMatches, sample: ImageSample) -> float | None:
    """Median part of the matches between turned cameras that are at the same pixel in both.

    ``None`` where there are too few pairs, and where masks leave the background out.
    """
    if any(image.valid < 1 for image in sample.images):
        return None
    axes = viewpoints.axes[matches.views]
    turned = axes @ axes.T < math.cos(math.radians(APART))
    shares = matches.unmoved[np.triu(turned)]
    shares = shares[np.isfinite(shares)]
    return float(np.median(shares)) if len(shares) >= FEWEST_PAIRS else None
