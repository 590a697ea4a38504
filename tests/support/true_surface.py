"""Points on the surface of the built-in scene, and distances of a mesh from it."""

from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import cKDTree

from gsfw.core.maths.rays import pixel_rays
from gsfw.datamanagers.synthetic.dome import dome
from gsfw.datamanagers.synthetic.scene import SyntheticScene, solids

THINNED = 20
"""One of so many points of the surface is asked for its distance from the mesh."""


def true_surface(views: int = 60, width: int = 480, height: int = 360) -> np.ndarray:
    """Points at time 0 that its cameras see, about 0.003 apart at that size: [n, 3]."""
    scene, cameras = SyntheticScene(solids(0), 0.0), dome(views, 0.0, width, height, 0)
    found = []
    for index in range(views):
        rays = pixel_rays(cameras.select([index]))[0].reshape(-1, 6).double().T.contiguous()
        hits = scene.trace(rays[:3], rays[3:])
        found.append(hits.points[:, hits.solid >= 0].T)
    return torch.cat(found).numpy()


@dataclass(frozen=True)
class Distances:
    """Median and 95 % of distances, in units of the world."""

    accuracy: tuple[float, float]
    """From vertices to the surface."""
    completeness: tuple[float, float]
    """From the surface to vertices."""


def distances(vertices: np.ndarray, surface: np.ndarray) -> Distances:
    """How far a mesh and the true surface are from one another."""
    away = cKDTree(surface).query(vertices)[0]
    missing = cKDTree(vertices).query(surface[::THINNED])[0]

    def both(values: np.ndarray) -> tuple[float, float]:
        return float(np.median(values)), float(np.quantile(values, 0.95))

    return Distances(both(away), both(missing))
