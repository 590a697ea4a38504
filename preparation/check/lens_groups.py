"""LensGroups: images that one lens took at one setting, by EXIF and size, and their focal lengths.

EXIF is read of the image files as they lie on disk; those that a tool wrote anew often have none.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from gsfw.core.datamanager import DataManager
from gsfw.datamanagers.capture import Capture
from gsfw.datamanagers.frames import Frame
from gsfw.preparation.check.viewpoints import Viewpoints
from gsfw.preparation.exif import Exif, read_exif

ROUND = 0.02
"""Sides of images of one lens may differ by this part: undistortion cuts each differently."""
MANY = 4
"""Images per focal length, from which on each is that of a lens, or of a setting of a zoom."""
FEWEST = 3
"""Images of a group below which nothing is said of it."""


@dataclass(frozen=True)
class LensGroup:
    """``k`` images of one lens."""

    views: Int[np.ndarray, " k"]
    """Viewpoints."""
    focals: Float[np.ndarray, "k 2"]
    """Focal lengths across and down, in longer sides of the image."""
    side: float
    """Longer side of the first image, in pixels."""
    exif: Exif | None
    """The camera that all of them state; ``None`` if they state none."""

    @property
    def exif_focal(self) -> float | None:
        """The focal length that EXIF tells, in longer sides of the image."""
        if self.exif is None:
            return None
        # The shape of the sensor hardly matters: 4:3 and 3:2 differ by 3 %.
        focal = self.exif.focal_pixels(4000, 3000)
        return None if focal is None else focal / 4000


def lens_groups(data: DataManager, viewpoints: Viewpoints) -> tuple[LensGroup, ...]:
    """Images of one lens; those that a data set says were taken by several cameras, apart."""
    exifs = _exifs(data)
    # A reconstruction that gives each photo a camera of its own has as many focal lengths as
    # photos; a few are those of a few lenses, or of the settings of a zoom.
    focals = np.round(np.log(viewpoints.intrinsics[:, 0, 0]) / ROUND)
    few = len(np.unique(focals)) <= max(1, len(focals) // MANY)
    known = viewpoints.stand_still or 2 * len(np.unique(viewpoints.physical)) <= len(viewpoints)
    groups: dict[Hashable, list[int]] = {}
    for view, name in enumerate(viewpoints.names):
        exif = exifs.get(name)
        longer = float(viewpoints.sizes[view].max())
        shape = float(viewpoints.sizes[view].min()) / longer
        sizes = (round(np.log(longer) / ROUND), round(np.log(shape) / ROUND))
        own = (viewpoints.physical[view] if known else 0, focals[view] if few else 0)
        groups.setdefault((exif.camera if exif else own, sizes), []).append(view)
    found = []
    for views in groups.values():
        if len(views) >= FEWEST:
            chosen = np.array(views)
            longer_sides = viewpoints.sizes[chosen].max(1, keepdims=True)
            focals = np.stack(
                [viewpoints.intrinsics[chosen, axis, axis] for axis in (0, 1)], axis=1
            )
            first = exifs.get(viewpoints.names[views[0]])
            found.append(LensGroup(chosen, focals / longer_sides, float(longer_sides[0, 0]), first))
    return tuple(found)


def _exifs(data: DataManager) -> dict[str, Exif]:
    """The cameras that image files state, by the names of the images."""
    if not isinstance(data, Capture):
        return {}
    frames: list[Frame] = [frame for frame in data.recording.frames if frame.shot is None]
    found = {frame.name: read_exif(frame.path) for frame in frames}
    return {name: exif for name, exif in found.items() if exif.names_camera}
