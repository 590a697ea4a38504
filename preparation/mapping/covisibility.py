"""Covisibility: which pictures of a model are held together by points that they both see.

Global mapping places groups of pictures whose links it has thrown out as wrong all the same,
anywhere: such a group sees no points together with the others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gsfw.preparation.mapping.observations import Observations

if TYPE_CHECKING:
    from pycolmap import Reconstruction

COMMON_POINTS = 30
"""Two pictures that see fewer points together do not hold each other: as many as COLMAP wants of a
picture that it adds. In three global mappings of 12 and 24 of the fox photos that went wrong, this
found the wrong ones in two; in one, wrong groups shared more."""


def held_together(seen: Observations) -> set[int]:
    """COLMAP's ids of the largest group of pictures that hold each other, directly or not."""
    from scipy import sparse

    size = (len(seen.picture_ids), len(seen.positions))
    sees = sparse.csr_array((np.ones(len(seen.points)), (seen.pictures, seen.points)), size)
    holds = (sees @ sees.T) >= COMMON_POINTS
    _, groups = sparse.csgraph.connected_components(holds, directed=False)
    if not len(groups):
        return set()
    return set(seen.picture_ids[groups == np.bincount(groups).argmax()].tolist())


def cut_loose(model: Reconstruction) -> int:
    """Take the poses from pictures that the largest group does not hold, and say how many."""
    held = held_together(Observations.of(model))
    loose = [number for number in model.reg_image_ids() if number not in held]
    for number in loose:
        model.deregister_frame(model.image(number).frame_id)
    model.update_point_3d_errors()
    return len(loose)
