"""Parallel views: cameras with one viewing direction, which do not tell their focal length.

Scaling depth and focal length alike leaves their images as they are (Sturm 1997, "Critical Motion
Sequences for Monocular Self-Calibration").
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

PARALLEL = 5.0
"""Degrees between a view and the mean of all below which all views are parallel: fox has 52, and
plush 92; a rendered straight flight whose focal length came out wrong has 2.9."""
GIVE_FOCAL = (
    "Compute the cameras again with the focal length that the camera has: "
    "gsfw prepare IMAGES out=DIR focal=PIXELS refine_focal=false."
)


def view_spread(views: Float[np.ndarray, "n 3"]) -> float:
    """Largest angle between a direction and the mean of all, in degrees.

    Args:
        views: unit vectors along which cameras look; one at least.
    """
    middle = views.mean(axis=0)
    cosines = views @ middle / max(np.linalg.norm(middle), np.finfo(np.float64).tiny)
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).max())
