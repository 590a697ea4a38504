"""Incremental mapping: camera poses by COLMAP, one image after another.

Schönberger and Frahm 2016, "Structure-from-Motion Revisited". COLMAP halves its own thresholds for
the first pair twice where nothing can be started; ``RELAXED`` goes on from there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from gsfw.preparation.cancellation import cancellable
from gsfw.preparation.mapping.mapping_rule import MappingRule

if TYPE_CHECKING:
    from pycolmap import IncrementalPipelineOptions, Reconstruction

    Models: TypeAlias = list[Reconstruction]
else:  # pycolmap is imported where it is needed.
    Models = list

SMALLEST = 3
"""Images; two alone tell nothing that a third could confirm."""
LEAST_POINTS = 15
"""A model of fewer points is none: each image has to see so many, even by ``RELAXED``, before
outliers go. Eight photos that were taken while turning on the spot are left with one."""
SEED = 0
GROWTH = 1.4
"""Growth of a model after which all of it is adjusted again, in images or points; COLMAP's default
of 1.1 takes 1.6 times as long for fox's cameras, and moves no error (0.814 pixels for 0.813)."""
REFINEMENTS = (1, 2)
"""Most repetitions of an adjustment of part of a model and of all of it, in which points are
completed and outliers go; COLMAP's default is 2 and 5."""


@dataclass(frozen=True)
class Strictness:
    """Thresholds of evidence for placing an image."""

    first_pair_matches: int
    first_pair_degrees: float
    """Median angle between the rays to points that the first pair sees."""
    forward_motion: float
    """Largest share of the first pair's motion that may point along the view."""
    image_points: int
    """Least number of the model's points that an image must see to be added."""
    image_share: float
    """Least share of the image's matches that must agree with its pose."""


USUAL = Strictness(100, 16.0, 0.95, 30, 0.25)
"""COLMAP's defaults."""
RELAXED = Strictness(30, 4.0, 1.0, 15, 0.15)
"""For captures of few or weakly linked images; 15 is also the fewest matches of any pair."""


def run_incremental(
    database: Path,
    folder: Path,
    rule: MappingRule,
    strictness: Strictness,
    registered: Callable[[int], None] = lambda count: None,
    start_from: Path | None = None,
    among: Sequence[str] = (),
) -> Models:
    """Compute poses.

    Args:
        database: COLMAP's, with features and verified matches.
        folder: an existing one; models are left in folders below it.
        rule: of which all but the principal point is heeded.
        strictness: how much evidence is asked for.
        registered: told how many images have been added by now, to all models together.
        start_from: folder of a model that is to grow; otherwise new ones are begun.
        among: names of the images that may get poses; empty for all.

    Returns:
        Models, the largest first; none where nothing could be reconstructed.
    """
    import pycolmap

    count = _counter(registered)
    pycolmap.set_random_seed(SEED)
    options = incremental_options(rule, strictness)
    options.image_names = list(among)
    models = cancellable(
        lambda token: pycolmap.incremental_mapping(
            database_path=database,
            # The folder does not matter: colours of images are not read here.
            image_path=folder,
            output_path=folder,
            options=options,
            input_path=start_from or "",
            # Also called where a model goes on, which then has its first pair already.
            initial_image_pair_callback=count(0 if start_from else 2),
            next_image_callback=count(1),
            cancellation_token=token,
        )
    )
    return solid(models.values())


def _counter(registered: Callable[[int], None]) -> Callable[[int], Callable[[], None]]:
    """Make callbacks that each add a number of images to one count, and report the count."""
    counts = [0]

    def count(images: int) -> Callable[[], None]:
        def added() -> None:
            counts[0] += images
            registered(counts[0])

        return added

    return count


def incremental_options(rule: MappingRule, strictness: Strictness) -> IncrementalPipelineOptions:
    """COLMAP's options."""
    from pycolmap import IncrementalPipelineOptions

    options = IncrementalPipelineOptions()
    options.extract_colors = False
    options.min_model_size = SMALLEST
    if not rule.thorough:
        options.ba_global_frames_ratio = options.ba_global_points_ratio = GROWTH
        options.ba_local_max_refinements, options.ba_global_max_refinements = REFINEMENTS
    options.num_threads = rule.jobs
    options.random_seed = SEED
    options.ba_refine_focal_length = rule.refine_focal
    options.mapper.abs_pose_refine_focal_length = rule.refine_focal
    options.constant_cameras = set(rule.known_cameras)
    # The views of a panorama have turns that are known.
    options.ba_refine_sensor_from_rig = False
    options.mapper.init_min_num_inliers = strictness.first_pair_matches
    options.mapper.init_min_tri_angle = strictness.first_pair_degrees
    options.mapper.init_max_forward_motion = strictness.forward_motion
    options.mapper.abs_pose_min_num_inliers = strictness.image_points
    options.mapper.abs_pose_min_inlier_ratio = strictness.image_share
    return options


def solid(models: Iterable[Reconstruction]) -> Models:
    """Models that rest on ``LEAST_POINTS`` or more, the largest first."""
    return largest_first(model for model in models if model.num_points3D() >= LEAST_POINTS)


def largest_first(models: Iterable[Reconstruction]) -> Models:
    """Models by registered images; of two with as many, the one with more points."""
    return sorted(models, key=lambda m: (-m.num_reg_images(), -m.num_points3D()))
