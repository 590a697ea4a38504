"""Databases of matches whose cameras are known: COLMAP's synthetic scenes, with noise."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

NOISE = 0.5
"""Pixels, standard deviation, of 1024x768."""


@dataclass(frozen=True)
class MatchedCapture:
    """A database, and the cameras that it was made with."""

    database: Path
    truth: Any
    """A pycolmap.Reconstruction."""

    def errors(self, model: Any) -> tuple[float, float]:
        """See ``pose_errors``."""
        images = self.truth.images.values()
        return pose_errors(model, {one.name: one.cam_from_world().matrix() for one in images})


def pose_errors(model: Any, truth: Mapping[str, np.ndarray]) -> tuple[float, float]:
    """How far a model's poses are from true ones, after the similarity that fits positions best.

    Args:
        model: a pycolmap.Reconstruction.
        truth: world to camera, [3, 4], by the names of images.

    Returns:
        The largest error of a rotation in degrees, and of a position over the spread of all.
    """
    found = {one.name: one.cam_from_world().matrix() for one in model.images.values()}
    poses, true = (np.array([known[name] for name in found]) for known in (found, truth))
    ours, theirs = (-np.einsum("cji,cj->ci", p[:, :, :3], p[:, :, 3]) for p in (poses, true))
    ours, theirs = ours - ours.mean(axis=0), theirs - theirs.mean(axis=0)
    scale, turn = _similarity(ours, theirs)
    distances = np.linalg.norm(scale * ours @ turn.T - theirs, axis=1)
    # The trace of a rotation by an angle is 1 + 2 cos of it.
    traces = np.einsum("cij,kj,cik->c", poses[:, :, :3], turn, true[:, :, :3])
    degrees = np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1)))
    return float(degrees.max()), float(distances.max() / theirs.std(axis=0).sum())


def _similarity(ours: np.ndarray, theirs: np.ndarray) -> tuple[float, np.ndarray]:
    """Scale and rotation that bring our centred points to theirs (Umeyama 1991)."""
    left, values, right = np.linalg.svd(theirs.T @ ours)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    return float((values * signs).sum() / (ours**2).sum()), left @ np.diag(signs) @ right


def matched_capture(
    folder: Path,
    images: int = 10,
    points: int = 200,
    linked: Callable[[int, int], bool] = lambda first, second: True,
    noise: float = NOISE,
    seed: int = 0,
    width: int = 1024,
) -> MatchedCapture:
    """Make one in a new file.

    Args:
        folder: an existing one.
        images: how many, with ids from 1.
        points: each is seen by all images.
        linked: whether two images have matches.
        noise: pixels.
        seed: of points, cameras and noise.
        width: of the images in pixels, with the same view.
    """
    path = folder / "database.db"
    pycolmap.set_random_seed(seed)
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs = 1
    options.num_frames_per_rig = images
    options.num_points3D = points
    options.camera_width, options.camera_height = width, width * 3 // 4
    options.camera_params = [1.25 * width, width / 2, options.camera_height / 2, 0.05]
    added = pycolmap.SyntheticNoiseOptions()
    added.point2D_stddev = noise
    database = pycolmap.Database.open(path)
    truth = pycolmap.synthesize_dataset(options, database)
    pycolmap.synthesize_noise(added, truth, database)
    for pair in combinations(range(1, images + 1), 2):
        if not linked(*pair):
            database.delete_matches(*pair)
            database.delete_two_view_geometry(*pair)
    database.close()
    return MatchedCapture(path, truth)


def partial_model(capture: MatchedCapture, folder: Path, numbers: Iterable[int]) -> Any:
    """What COLMAP makes of some of the images alone: a pycolmap.Reconstruction.

    Args:
        capture: with these images.
        folder: for files; made where it is missing.
        numbers: ids of the images.
    """
    from gsfw.preparation.mapping.incremental_mapping import USUAL, incremental_options
    from gsfw.preparation.mapping.mapping_rule import MappingRule

    folder.mkdir(exist_ok=True)
    options = incremental_options(MappingRule(), USUAL)
    options.image_names = [capture.truth.image(number).name for number in numbers]
    models = pycolmap.incremental_mapping(capture.database, folder, folder, options)
    return models[0]
