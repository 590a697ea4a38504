"""Track places: whether the points that a reconstruction saw in an image lie in that image."""

from __future__ import annotations

import numpy as np

from gsfw.core.datamanager import DataManager
from gsfw.datamanagers.capture import Capture
from gsfw.preparation.check.viewpoints import Viewpoints

FEWEST = 30
"""Points of an image below which nothing is said: COLMAP places one from 30."""
OUTSIDE = 0.5
"""Part of its points that may lie outside: of fox none does, of cameras turned by 40 degrees
nearly all."""
MOST = 0.5
"""Part of the images from which on poses are wrong as a whole, and none is misplaced."""


def off_tracks(data: DataManager, viewpoints: Viewpoints) -> tuple[int, ...]:
    """Views that do not show most of the points that were matched in them, the worst first."""
    if not isinstance(data, Capture):
        return ()
    sightings = data.recording.read_sightings()
    number = {name: view for view, name in enumerate(viewpoints.names)}
    view_of = np.array([number[frame.name] for frame in data.recording.frames])
    points = data.scene.points.double().numpy()
    shares = np.full(len(viewpoints), np.nan)
    for view in range(len(viewpoints)):
        own = sightings.points[view_of[sightings.frames] == view]
        if len(own) >= FEWEST:
            shares[view] = 1 - viewpoints.project(view, points[own])[1].mean()
    known = np.isfinite(shares)
    off = np.flatnonzero(known & (np.where(known, shares, 0) > OUTSIDE))
    if len(off) > MOST * known.sum():
        return ()
    return tuple(off[np.argsort(-shares[off], kind="stable")].tolist())
