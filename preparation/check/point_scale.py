"""Point scale: whether the points are as far from the cameras as what images match on."""

from __future__ import annotations

import numpy as np

from gsfw.preparation.check.pose_agreement import Triangulation
from gsfw.preparation.check.survey import Survey

LEAST_ANGLE = 3.0
"""Degrees between two rays from which on their depth is certain to 10 % or so."""
FEWEST, FEWEST_VIEWS = 10, 5
"""Matches of a view, and views, below which nothing is said."""
OTHER = 2.5
"""Factor of the depths that another place in the images cannot explain: 0.9 to 1.1 in fox and
plush."""
SIDES = 0.9
"""Part of the views in which points have to lie on that side."""


def points_factor(survey: Survey) -> float | None:
    """Depths of the points over those of matches, where they surely differ; else ``None``."""
    factors = depth_factors(survey)
    if len(factors) < FEWEST_VIEWS:
        return None
    factor = float(np.median(factors))
    far = float((factors > OTHER).mean())
    near = float((factors < 1 / OTHER).mean())
    return factor if max(far, near) >= SIDES else None


def depth_factors(survey: Survey) -> np.ndarray:
    """Median depth of the points in a view over that of its matches, for each view with both."""
    check, viewpoints, scene = survey.cross_check, survey.viewpoints, survey.scene
    if survey.surface is None or not survey.surface.measured:
        return np.zeros(0)
    found = Triangulation.of(check.matches, check.rig)
    known = found.agrees & (found.angles > LEAST_ANGLE)
    ends = check.matches.pairs[check.matches.pair[known]]
    depths = found.depths[known] * scene.world_from_scene.inverse().scale
    factors = []
    for view in np.unique(ends).tolist():
        own = depths[ends == view]
        points = survey.surface.points
        _, inside = viewpoints.project(view, points)
        if len(own) < FEWEST or inside.sum() < FEWEST:
            continue
        offsets = points[inside] - viewpoints.centers[view]
        factors.append(float(np.median(offsets @ viewpoints.axes[view]) / np.median(own)))
    return np.array(factors)
