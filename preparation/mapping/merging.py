"""Merging: several models of one capture joined to the largest, where they share images.

Two models that share an image differ by a similarity, which follows from that image alone: its
two poses give the rotation and the translation, and the depths of the points that it sees in both
give the scale. The rest is COLMAP's triangulation and bundle adjustment of the union, which is
refused where its error grows or the links between the two do not hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsfw.preparation.cancellation import cancellable
from gsfw.preparation.mapping.bundle_adjustment import adjust, adjustment_options
from gsfw.preparation.mapping.incremental_mapping import RELAXED, Models, incremental_options
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.mapping.observations import Observations
from gsfw.preparation.match_list import Pair
from gsfw.preparation.native import names_by_number, opened_database

if TYPE_CHECKING:
    from pycolmap import Reconstruction, Rigid3d, Sim3d

COMMON_POINTS = 10
"""A shared image tells the scale only where it sees so many points of both models."""
SHARED_BY_RANSAC = 3
"""Number of shared images from which on COLMAP aligns models, and finds poses that do not fit."""
IMAGE_POINTS = 15
"""Fewest points that an image must see in the union, as for any image that is added."""
LINKS_KEPT = 0.5
"""Least share of the tracks from shared to added images that must hold in the union."""
ERROR_GROWTH = 1.5
"""Largest mean reprojection error of a larger model, over that of the smaller one: some growth is
due to longer tracks (12 of the fox photos: 0.64 pixels; 24 of them: 0.82)."""
FINE_ERROR = 1.0
"""Pixels; a model of less is fine, however much less it was before."""
WELL_LINKED = 60
"""Verified matches of a pair that would have joined two models, if anything could."""
MOST_BRIDGES = 300
"""Pairs that are matched again: a minute or two of two cores."""
LARGEST_ERROR = 4.0
"""Pixels; observations beyond it are outliers, as in COLMAP's own mapping."""
SMALLEST_ANGLE = 1.5
"""Degrees between rays to a point, as in COLMAP's own mapping."""


def merge_models(
    models: Models, database: Path, folder: Path, rule: MappingRule
) -> tuple[Models, int]:
    """Join models to the largest one.

    Args:
        models: pycolmap.Reconstructions of one database, the largest first.
        database: that one.
        folder: an existing one, for files that nobody needs afterwards.
        rule: by which the models were made.

    Returns:
        The models that are left, the joined one first, and how many were joined to it.
    """
    left = list(models)
    joined = 0
    position = 1
    while position < len(left):
        union = _join(left[0], left[position], database, folder, rule)
        if union is None:
            position += 1
            continue
        del left[position]
        left[0] = union
        joined += 1
        # Models that did not fit before may share images with the added ones.
        position = 1
    return left, joined


def bridge_pairs(
    database: Path, models: Sequence[Path], most: int = MOST_BRIDGES
) -> tuple[Pair, ...]:
    """Pairs to match again, more closely, so that the largest model may grow into others.

    Args:
        database: with what has been matched so far.
        models: folders, the largest first.
        most: how many pairs at most.

    Returns:
        Names of an image of the largest model and of one that it lacks, with few verified matches
        or none; the most promising first: those with most features that look alike, and then those
        that are nearest to each other in the database.
    """
    import pycolmap

    inside = set(pycolmap.Reconstruction(models[0]).reg_image_ids()) if models else set()
    with opened_database(database, "read the matches") as opened:
        names = names_by_number(opened)
        alike = dict(zip(*opened.read_num_matches(), strict=True))
        verified = dict(zip(*opened.read_two_view_geometry_num_inliers(), strict=True))
    ranked = [
        (-alike.get(pair, 0), abs(one - other), one, other)
        for one in sorted(inside)
        for other in sorted(names.keys() - inside)
        if verified.get(pair := pycolmap.image_pair_to_pair_id(one, other), 0) < WELL_LINKED
    ]
    return tuple((names[one], names[other]) for *_, one, other in sorted(ranked)[:most])


def _join(
    target: Reconstruction, source: Reconstruction, database: Path, folder: Path, rule: MappingRule
) -> Reconstruction | None:
    """Both in one; None where they share nothing, or do not fit."""
    shared = {first for first, _ in target.find_common_reg_image_ids(source)}
    added = set(source.reg_image_ids()) - shared
    if not added:
        return target
    target_from_source = _alignment(target, source, sorted(shared))
    if target_from_source is None:
        return None
    from pycolmap import Reconstruction

    moved, union = Reconstruction(source), Reconstruction(target)
    moved.transform(target_from_source)
    for number in sorted({moved.image(one).frame_id for one in added}):
        _add_frame(union, moved, number)
    union = _refined(union, database, folder, rule)
    return union if _is_sound(union, target, source, added) else None


def _alignment(target: Reconstruction, source: Reconstruction, shared: list[int]) -> Sim3d | None:
    """The similarity that brings the source to the target; None where there is none."""
    if len(shared) >= SHARED_BY_RANSAC:
        from pycolmap import align_reconstructions_via_reprojections

        found = align_reconstructions_via_reprojections(source, target)
        if found is not None:
            return found
    here, there = Observations.of(target), Observations.of(source)
    candidates = [_by_image(target, source, here, there, number) for number in shared]
    known = [candidate for candidate in candidates if candidate is not None]
    if not known:
        return None
    # The one image that most others agree with; of two, the first.
    centers = np.array([target.image(number).projection_center() for number in shared])
    others = np.array([source.image(number).projection_center() for number in shared])
    distances = [
        float(np.median(np.linalg.norm(np.array([s * c for c in others]) - centers, axis=1)))
        for s in known
    ]
    return known[int(np.argmin(distances))]


def _by_image(
    target: Reconstruction,
    source: Reconstruction,
    here: Observations,
    there: Observations,
    number: int,
) -> Sim3d | None:
    """The similarity that one shared image tells; None where it sees too few common points."""
    from pycolmap import Sim3d

    features, in_target, in_source = np.intersect1d(
        here.features_of(number), there.features_of(number), return_indices=True
    )
    if len(features) < COMMON_POINTS:
        return None
    world, other_world = (model.image(number).cam_from_world() for model in (target, source))
    depths = _depths(world, here.points_of(number)[in_target])
    other_depths = _depths(other_world, there.points_of(number)[in_source])
    usable = (depths > 0) & (other_depths > 0)
    if usable.sum() < COMMON_POINTS:
        return None
    scale = float(np.median(depths[usable] / other_depths[usable]))
    # A point of the source goes to the camera, is scaled there, and goes to the target's world.
    scaled = Sim3d(scale, other_world.rotation, scale * other_world.translation)
    back: Rigid3d = world.inverse()
    return Sim3d(1.0, back.rotation, back.translation) * scaled


def _depths(camera_from_world: Rigid3d, points: np.ndarray) -> np.ndarray:
    matrix = camera_from_world.matrix()
    depths: np.ndarray = points @ matrix[2, :3] + matrix[2, 3]
    return depths


def _add_frame(union: Reconstruction, moved: Reconstruction, number: int) -> None:
    """Add a frame with its pose and images, and its rig where that is new; without points."""
    from pycolmap import Frame, Image

    given = moved.frame(number)
    if not union.exists_rig(given.rig_id):
        rig = moved.rig(given.rig_id)
        for sensor in rig.sensor_ids():
            if not union.exists_camera(sensor.id):
                union.add_camera(moved.camera(sensor.id))
        union.add_rig(rig)
    frame = Frame(frame_id=number, rig_id=given.rig_id)
    frame.rig_from_world = given.rig_from_world
    for data in given.data_ids:
        frame.add_data_id(data)
    union.add_frame(frame)
    for data in given.data_ids:
        image = moved.image(data.id)
        features = np.array([point.xy for point in image.points2D]).reshape(-1, 2)
        added = Image(image.name, features, image.camera_id, data.id)
        added.frame_id = number
        union.add_image(added)
    union.register_frame(number)


def _refined(
    union: Reconstruction, database: Path, folder: Path, rule: MappingRule
) -> Reconstruction:
    """Points anew from all matches, and poses and points adjusted.

    This is done twice, since the first time triangulates with poses of two models.
    """
    import pycolmap

    for _ in range(2):
        union = adjusted(_triangulated(union, database, folder, rule), rule)
        pycolmap.ObservationManager(union).filter_all_points3D(LARGEST_ERROR, SMALLEST_ANGLE)
    union.update_point_3d_errors()
    return union


def _triangulated(
    model: Reconstruction, database: Path, folder: Path, rule: MappingRule
) -> Reconstruction:
    from pycolmap import triangulate_points

    options = incremental_options(rule, RELAXED)
    return cancellable(
        lambda token: triangulate_points(
            model, database, folder, folder, options=options, cancellation_token=token
        )
    )


def adjusted(
    model: Reconstruction, rule: MappingRule, principal_point: bool = False
) -> Reconstruction:
    """A model after bundle adjustment of all that it has: the same object.

    Args:
        model: a pycolmap.Reconstruction.
        rule: whether focal lengths are computed, and by how many threads.
        principal_point: whether principal points are computed.
    """
    options = adjustment_options(rule.jobs)
    options.refine_focal_length = rule.refine_focal
    options.refine_principal_point = principal_point
    adjust(model, options, rule.known_cameras)
    return model


def _is_sound(
    union: Reconstruction, target: Reconstruction, source: Reconstruction, added: set[int]
) -> bool:
    """True if all images of both are held in place, as well as before."""
    shared = set(source.reg_image_ids()) - added
    before, after = Observations.of(source), Observations.of(union)
    links = [int((o.seen_by(shared) & o.seen_by(added)).sum()) for o in (before, after)]
    error = max(model.compute_mean_reprojection_error() for model in (target, source))
    return bool(
        set(union.reg_image_ids()) == set(target.reg_image_ids()) | added
        and after.by_frame(union).counts.min() >= IMAGE_POINTS
        and links[1] >= max(LINKS_KEPT * links[0], IMAGE_POINTS)
        and is_as_precise(union, error)
    )


def is_as_precise(model: Reconstruction, error: float) -> bool:
    """True if a model that has grown fits as well as before.

    Args:
        model: the new one.
        error: mean reprojection error of the old one, in pixels.
    """
    new: float = model.compute_mean_reprojection_error()
    return new <= max(ERROR_GROWTH * error, FINE_ERROR)
