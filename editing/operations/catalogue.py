"""Catalogue: every operation by the name that it has on the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gsfw.editing import colors
from gsfw.editing.operations import joining, looks, places, pruning, reduction, regions
from gsfw.editing.operations.edit import Edit


@dataclass(frozen=True)
class Operation:
    """A kind of edit."""

    parse: Callable[[str], Edit]
    """Reads the value; raises ``ValueError`` with what was expected."""
    example: str
    """A value."""
    renders: bool = False
    """True if it measures what each Gaussian adds to the views."""


OPERATIONS: Mapping[str, Operation] = {
    "crop.box": Operation(regions.crop(regions.box), "-1,-1,-1,1,1,1"),
    "crop.sphere": Operation(regions.crop(regions.sphere), "0,0,0,1.5"),
    "crop.views": Operation(regions.crop_views, "3"),
    "cut.box": Operation(regions.cut(regions.box), "-1,-1,-1,1,1,1"),
    "cut.sphere": Operation(regions.cut(regions.sphere), "0,0,0,0.2"),
    "move": Operation(places.transform(places.translation), "0,0,1"),
    "rotate": Operation(places.transform(places.rotation), "x,90"),
    "scale": Operation(places.transform(places.scaling), "2"),
    "true_size": Operation(places.transform(places.true_size), "0,0,0,0,0,1,2.5"),
    "align": Operation(places.align, "cameras,z"),
    "floor": Operation(places.floor_at, "0"),
    "merge": Operation(joining.merge, "other.ply"),
    "prune.opacity": Operation(pruning.prune_opacity, "0.02"),
    "prune.contribution": Operation(pruning.prune_contribution, "0.3", renders=True),
    "prune.floaters": Operation(pruning.prune_floaters, "4"),
    "prune.views": Operation(pruning.prune_views, "2", renders=True),
    "clean": Operation(pruning.clean, pruning.ALL),
    "sh_degree": Operation(reduction.sh_degree, "1"),
    "decimate.count": Operation(reduction.decimate_count, "50000", renders=True),
    "decimate.mb": Operation(reduction.decimate_mb, "5", renders=True),
    "color.brightness": Operation(looks.factor(colors.brightness), "1.2"),
    "color.contrast": Operation(looks.factor(colors.contrast), "1.1"),
    "color.saturation": Operation(looks.factor(colors.saturation), "0.8"),
    "color.white": Operation(looks.white, "0.9,0.85,0.7"),
}
"""Every operation by its name on the command line."""
