"""MeshExporter: the surface of a model as triangles with colours, from its depth images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import DepthView, Exporter, ExportSource, Holds
from gsfw.core.ranges import number
from gsfw.formats.mesh.blocks import Blocks
from gsfw.formats.mesh.components import large_parts
from gsfw.formats.mesh.files import WRITERS, write_mesh
from gsfw.formats.mesh.fusion import FusionRule, fuse, surface_points
from gsfw.formats.mesh.surface_nets import Mesh, surface_net

MOST_VOXELS = 1 << 24
"""Voxels at most; they and the search for the surface take 100 bytes each."""
TRUNCATION = 4.0
"""Truncation in voxels."""
FAR = 3.0
"""Largest depth in median depths, unless max_depth is given: backgrounds are far and inexact."""
FINEST = 0.5
"""Smallest voxel in pixels at the median depth: depth images show no more detail."""
OUTSIDE = 0.01
"""Part of the seen points, at each end of each axis, that the resolution does not count."""
SAMPLE = 4000
"""Points of a view by which the size of the scene is measured."""
NO_SURFACE = "no view shows a surface. Lower format.least_alpha, or raise format.max_depth"


@dataclass(frozen=True)
class MeshExporter(Exporter):
    """Fuses the depths that training views show into a signed distance, and meshes its zero."""

    suffix = ".mesh.ply"
    other_suffixes = tuple(WRITERS)
    is_readable = False
    holds = Holds.DEPTHS

    resolution: int = number(256, at_least=8, at_most=4096)
    """Voxels along the longest side of the surfaces at voxel=0; fewer where pixels are larger."""
    voxel: float = number(0.0, at_least=0, below=math.inf)
    """Size of a voxel in units of the data. 0: by resolution."""
    max_depth: float = number(0.0, at_least=0, below=math.inf)
    """Distance from a camera, in units of the data, beyond which nothing counts. 0: three times the
    median distance."""
    least_alpha: float = number(0.5, at_least=0, at_most=1)
    """Coverage, in [0, 1], that a pixel needs to show a surface."""
    min_views: int = number(2, at_least=1, at_most=1000)
    """Views that have to see a place."""
    min_part: float = number(0.02, at_least=0, at_most=1)
    """Connected parts with fewer triangles than this part of the largest one are left out. 0: none
    are; 1: all but the largest."""

    def write(self, path: Path, source: ExportSource) -> None:
        """Write the file atomically: .glb, .obj, or .ply.

        Raises:
            OutputError: it cannot be written.
            ConfigError: the suffix is of no mesh, or the voxels do not fit the scene.
            ValueError: no view shows a surface.
        """
        if path.suffix.lower() not in WRITERS:
            raise ConfigError(
                f"format=mesh writes {', '.join(WRITERS)}, and no file such as {path.name}.",
                f"Name it {path.with_suffix('.ply').name}, for example.",
            )
        views = source.depth_views()
        write_mesh(path, self.mesh(views), views[0].up if views else "")

    def mesh(self, views: Sequence[DepthView]) -> Mesh:
        """The mesh of what some views show.

        Raises:
            ConfigError: the voxels do not fit the scene.
            ValueError: no view shows a surface.
        """
        blocks, rule = self._grid(views)
        fused = fuse(blocks, views, rule)
        known = fused.counts >= min(self.min_views, len(views))
        mesh = surface_net(blocks, fused.distances, known, fused.colors)
        if len(mesh.triangles) == 0:
            raise ValueError(
                f"no surface is seen by {self.min_views} views. Lower format.min_views or "
                "format.least_alpha"
            )
        return mesh.take(large_parts(mesh, self.min_part))

    def _grid(self, views: Sequence[DepthView]) -> tuple[Blocks, FusionRule]:
        """The voxels around the seen surface, and the rule of the fusion."""
        median, footprint = _median_depth(views, self.least_alpha)
        reach = self.max_depth or FAR * median
        on_surface = FusionRule(0.0, reach, self.least_alpha)
        points = [_sample(next(surface_points(view, on_surface))) for view in views]
        seen = np.concatenate([np.zeros((0, 3)), *points])
        if len(seen) == 0:
            raise ValueError(NO_SURFACE)
        low, high = np.quantile(seen, [OUTSIDE, 1 - OUTSIDE], axis=0)
        side = max(float((high - low).max()), 1e-9)
        voxel = self.voxel or max(side / self.resolution, FINEST * footprint)
        self._check_voxel(voxel, side)
        rule = FusionRule(TRUNCATION * voxel, reach, self.least_alpha)
        parts = (part for view in views for part in surface_points(view, rule))
        try:
            return Blocks.around(parts, low, voxel, MOST_VOXELS), rule
        except ValueError as error:
            raise self._too_fine(str(error)) from None

    def _check_voxel(self, voxel: float, side: float) -> None:
        """Check the size of a voxel against the longest side of the seen surfaces.

        Raises:
            ConfigError: it is larger, or too small for the grid.
            ValueError: no size was given, and the surfaces are smaller than a pixel.
        """
        if voxel > side and not self.voxel:
            raise ValueError(NO_SURFACE)
        if voxel > side:
            raise ConfigError(
                f"format.voxel={voxel:g} is larger than the surfaces, whose longest side is "
                f"{side:.3g}.",
                f"Give less, such as format.voxel={side / self.resolution:.2g}, or leave it out.",
            )
        if side / voxel > MOST_VOXELS:
            raise self._too_fine(f"the surfaces are {side / voxel:.3g} such voxels long")

    def _too_fine(self, cause: str) -> ConfigError:
        """The error for voxels that are too small, with the option that chose their size."""
        chosen, remedy = f"format.resolution={self.resolution}", "Lower it"
        if self.voxel:
            chosen, remedy = f"format.voxel={self.voxel:g}", "Raise it"
        return ConfigError(f"{chosen}: {cause}.", f"{remedy}, or lower format.max_depth.")


def _median_depth(views: Sequence[DepthView], least_alpha: float) -> tuple[float, float]:
    """Median depth of all surfaces, infinite if there are none; and the size of a pixel there."""
    depths = [_sample(view.depth[view.alpha >= least_alpha].numpy()) for view in views]
    joined = np.concatenate([np.zeros(0), *depths])
    joined = joined[np.isfinite(joined) & (joined > 0)]
    if len(joined) == 0:
        return np.inf, 0.0
    median = float(np.median(joined))
    focal = float(np.median([float(view.camera.intrinsics[0, 0, 0]) for view in views]))
    return median, median / focal


def _sample(values: Float[np.ndarray, "n ..."]) -> Float[np.ndarray, "m ..."]:
    return values[:: len(values) // SAMPLE + 1]
