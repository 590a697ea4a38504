"""Findings about the computed model: its fit, and the plausibility of its cameras.

Angles of view, baselines and points of the written data set are judged by ``gsfw check``.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator

import numpy as np

from gsfw.core.words import counted, listed
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.model_figures import CameraFigures, ModelFigures
from gsfw.preparation.diagnosis.own_focals import PER_IMAGE, UNLIKE
from gsfw.preparation.finding import Finding, Weight
from gsfw.preparation.parallel_views import PARALLEL

FEWEST_POINTS = 100
"""Points of a model that is more than chance: three photos of the built-in scene of 320 pixels have
382. Models of next to none are dropped before (``LEAST_POINTS`` of the mapper)."""
LARGE_ERROR = 1.5
"""Pixels, mean: fox has 0.7; lenses that a model does not fit and rolling shutters make 2 and more,
up to the 4 at which COLMAP drops observations."""
BAD_IMAGE, BAD_ERROR = 2.0, 1.5
"""Errors from which on an image fits badly: in usual errors, and in pixels."""
SHORT_TRACK = 3.0
"""Images that see a point, mean: two that see a point agree on it whatever their poses are."""
SURE = 3
"""Images from which a focal length is computed that others can be compared with."""
BENT = 0.5
"""Shift of a corner by distortion, in parts of its radius: phones stay below 0.1, action cameras
below 0.4."""


def camera_findings(evidence: Evidence) -> Iterator[Finding]:
    """Everything that the largest model shows; nothing where there is none."""
    figures = evidence.figures
    if figures is None:
        return
    if figures.points < FEWEST_POINTS:
        yield _hollow(figures)
        return
    yield from _errors(figures)
    yield from _stretch(figures)
    yield from _tracks(figures)
    yield from _parallel_views(figures)
    yield from _focal_guesses(figures)
    yield from _focals_of_one_lens(evidence, figures)
    yield from _distortion(figures)


def focal_findings(evidence: Evidence) -> Iterator[Finding]:
    """Images of another focal length, which others of the findings follow from."""
    figures = evidence.figures
    if figures is None or not figures.own_focals:
        return
    own = figures.own_focals
    members = {name: group.number for group in evidence.groups for name in group.images}
    cameras = {members[name] for name in own}
    shared = [camera.focal for camera in figures.cameras if camera.number in cameras]
    fit, their = ("fits", "its") if len(own) == 1 else ("fit", "their")
    yield Finding(
        "several focal lengths",
        Weight.LIMIT,
        f"{len(own)} of {figures.registered} images {fit} far better with a focal length of "
        f"{_range(own.values())} pixels than with that of {their} camera ({_range(shared)}): "
        f"{listed(list(own))}.",
        "The lens was zoomed or exchanged, and that was computed as a movement of the camera: "
        "poses are wrong, and images may be missing.",
        PER_IMAGE,
        tuple(own),
    )


def _range(focals: Collection[float]) -> str:
    low, high = f"{min(focals):.0f}", f"{max(focals):.0f}"
    return low if low == high else f"{low} to {high}"


def _hollow(figures: ModelFigures) -> Finding:
    points = counted(figures.points, "point")
    return Finding(
        "hollow model",
        Weight.STOP,
        f"The cameras of {figures.registered} images rest on {points}.",
        "So few agree by chance: the poses are unreliable.",
        "Take sharp images of something with texture, from places around it, each overlapping "
        "the next by two thirds.",
    )


def _errors(figures: ModelFigures) -> Iterator[Finding]:
    if figures.error > LARGE_ERROR:
        yield Finding(
            "reprojection error",
            Weight.LIMIT,
            f"Points are {figures.error:.1f} pixels from where images show them (mean); below 1 "
            "is usual.",
            "The poses are inaccurate, and the result is blurred.",
            "Choose a camera model that fits the lens (camera_model=OPENCV, or OPENCV_FISHEYE for "
            "a very wide one), turn electronic stabilisation off, and avoid fast movement: rolling "
            "shutters bend the image.",
        )
    usual = float(np.median(list(figures.errors.values())))
    limit = max(BAD_IMAGE * usual, BAD_ERROR)
    bad = sorted(
        (
            name
            for name, error in figures.errors.items()
            if error > limit and name not in figures.own_focals
        ),
        key=lambda name: -figures.errors[name],
    )
    if bad:
        yield Finding(
            "images that fit badly",
            Weight.LIMIT,
            f"{len(bad)} of {figures.registered} images are {limit:.1f} pixels or more off where "
            f"{usual:.1f} are usual: {listed(list(bad))}.",
            "Their poses are wrong or uncertain, and blur what others show sharply.",
            "Look at them, and leave them out if they are blurred or show something that moved.",
            tuple(bad),
        )


def _stretch(figures: ModelFigures) -> Iterator[Finding]:
    stretch = figures.stretch
    # One focal length for images of several stretches each in another way, too.
    if stretch.is_suspicious and not figures.own_focals:
        yield Finding(
            "rolling shutter",
            Weight.LIMIT,
            f"Images are stretched by {stretch.pixels:.1f} pixels at their edges (median), each "
            f"in another way, {stretch.ratio:.0f} times what noise explains.",
            "A shutter that reads row after row bends images of a moving camera, and no pose "
            "fits all of one. Things that move in the scene have the same effect.",
            "Stand still for each photo, or move slowly in good light; turn electronic "
            "stabilisation off. If something moves, let what stands still fill most of each image.",
        )


def _tracks(figures: ModelFigures) -> Iterator[Finding]:
    tracks = figures.tracks
    if tracks.mean_length < SHORT_TRACK:
        yield Finding(
            "short tracks",
            Weight.LIMIT,
            f"A point is seen by {tracks.mean_length:.1f} images (mean), and "
            f"{100 * tracks.share_of_pairs:.0f} % of the points by two only.",
            "Little ties the images to each other, so that poses may drift.",
            "Take photos closer to each other: each should overlap the next by two thirds.",
        )


def _parallel_views(figures: ModelFigures) -> Iterator[Finding]:
    if has_computed_focal(figures) and figures.baselines.view_spread < PARALLEL:
        yield Finding(
            "parallel views",
            Weight.LIMIT,
            f"All {figures.registered} views have one direction, within "
            f"{figures.baselines.view_spread:.1f} degrees, and the focal length was computed from "
            "them.",
            "Parallel views do not tell the focal length: it may be wrong, and the scene "
            "stretched in depth.",
            "Give the focal length (focal=PIXELS refine_focal=false), or add images that look at "
            "the same things from the side, such as a second flight with a tilted camera.",
        )


def has_computed_focal(figures: ModelFigures) -> bool:
    """True if a focal length is neither the given one nor confirmed by EXIF."""
    return not all(_is_known(camera) for camera in figures.cameras)


def _is_known(camera: CameraFigures) -> bool:
    """True if the focal length is the given one, or agrees with EXIF."""
    ratio = camera.focal_ratio
    is_like = ratio is not None and max(ratio, 1 / ratio) <= UNLIKE
    return camera.focal == camera.first_focal or (bool(camera.focal_origin) and is_like)


def _focal_guesses(figures: ModelFigures) -> Iterator[Finding]:
    for camera in figures.cameras:
        ratio = camera.focal_ratio
        if ratio is None or not camera.focal_origin or camera.images < SURE:
            continue
        if max(ratio, 1 / ratio) > UNLIKE:
            origin = "EXIF says" if camera.focal_origin == "EXIF" else "was given"
            yield Finding(
                "focal length unlike EXIF"
                if camera.focal_origin == "EXIF"
                else "focal length unlike the given one",
                Weight.LIMIT,
                f"{_named(camera)} has a focal length of {camera.focal:.0f} pixels, where "
                f"{origin} {camera.first_focal:.0f}.",
                "One of them is wrong: cropped or zoomed images keep their EXIF, and a model "
                "from poor matches bends space.",
                "If images are as the camera took them, keep its focal length with "
                "refine_focal=false, and compare.",
            )


def _focals_of_one_lens(evidence: Evidence, figures: ModelFigures) -> Iterator[Finding]:
    """Upright and sideways photos of one phone are two cameras of one lens."""
    groups = {group.number: group for group in evidence.groups}
    lenses: dict[object, list[CameraFigures]] = {}
    for camera in figures.cameras:
        exif = evidence.images.by_name[groups[camera.number].images[0]].exif
        if exif.names_camera and camera.images >= SURE:
            lenses.setdefault(exif.camera, []).append(camera)
    for cameras in lenses.values():
        relative = [camera.focal / max(camera.width, camera.height) for camera in cameras]
        if max(relative) > UNLIKE * min(relative):
            all_of_it = ", ".join(
                f"{camera.focal:.0f} pixels for {camera.width}x{camera.height}"
                for camera in cameras
            )
            yield Finding(
                "one lens, several focal lengths",
                Weight.LIMIT,
                f"Images of one camera and lens have different focal lengths: {all_of_it}.",
                "If it was not zoomed, the model has bent space to fit one of them.",
                "Give the focal length that is right (focal=PIXELS refine_focal=false), or take "
                "all images one way up.",
            )


def _distortion(figures: ModelFigures) -> Iterator[Finding]:
    for camera in figures.cameras:
        moved = corner_shift(camera)
        if abs(moved) > BENT:
            yield Finding(
                "distortion",
                Weight.LIMIT,
                f"{_named(camera)} moves the corners of its images by {100 * abs(moved):.0f} % "
                f"{'outwards' if moved > 0 else 'inwards'}.",
                "Hardly any lens does; the model has bent space to fit poor matches, or the lens "
                "is a fisheye.",
                "For a fisheye, use camera_model=OPENCV_FISHEYE; else camera_model=SIMPLE_RADIAL "
                "has less to go wrong.",
            )


def corner_shift(camera: CameraFigures) -> float:
    """Shift of a corner by radial distortion, in parts of its radius; 0 for fisheye models."""
    terms = camera.distortion
    if "FISHEYE" in camera.model:
        return 0.0
    square = (math.hypot(camera.width, camera.height) / 2 / camera.focal) ** 2
    return terms.get("k", terms.get("k1", 0.0)) * square + terms.get("k2", 0.0) * square**2


def _named(camera: CameraFigures) -> str:
    return f"Camera {camera.number} ({camera.images} images)"
