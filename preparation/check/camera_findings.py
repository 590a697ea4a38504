"""Findings about the cameras: their number, poses and neighbours."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsfw.core.words import counted, listed
from gsfw.preparation.check.coverage import looked_at, widest_gap
from gsfw.preparation.check.lens_findings import lens_findings
from gsfw.preparation.check.pose_findings import pose_findings
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.check.up_axis import up_axis
from gsfw.preparation.finding import Finding, Weight

FEWEST_VIEWS = 3
"""Smallest number of views that determines depth redundantly: with two, nothing contradicts a wrong
depth."""
FEW_VIEWS = 20
"""The shared sets that train well have 40 and more; nine (garden_robot_mv) show seams between."""
FLAT, LINE = 1.5, 5.0
"""Degrees between the outermost rays to a point: COLMAP drops points below 1.5
(``filter_min_tri_angle``), and depth there is uncertain by 1 / sin(5 degrees) = 11 times the
uncertainty across."""
STRAIGHT = 0.02
"""Cameras are on a line if they leave it by this part of its length; a ring of the shared sets
leaves it by 0.28 at least."""
FAR_NEIGHBOR = 30.0
"""Degrees to the nearest view of the same: about where SIFT stops finding its features again, and
twice what the shared sets that train well have as their median (4 to 16)."""
FAR_HELD_OUT = 2.0
"""Held-out views are far from trained ones if that angle is this multiple of the angle between
trained views."""
HELD_OUT_FROM = 5.0
"""Angle in degrees below which held-out views are near, even if trained views are nearer."""
OPEN_SIDE = 120.0
"""Degrees without a camera around what is looked at: a third of the sides was never seen."""


def camera_findings(survey: Survey) -> Iterator[Finding]:
    """All findings about poses, lenses and photos without a camera."""
    yield from _number(survey)  # It decodes nothing, so it is told at once.
    yield from pose_findings(survey)
    yield from _spread(survey)
    if not (survey.cross_check.cameras_wrong or survey.cross_check.other_scene):
        yield from _neighbors(survey)
        yield from _held_out(survey)
        yield from _open_side(survey)
    yield from lens_findings(survey)
    yield from _leftover_photos(survey)


def _number(survey: Survey) -> Iterator[Finding]:
    viewpoints = survey.viewpoints
    views = int(viewpoints.trained.sum())
    places = _different_centers(survey)
    what = f"{counted(views, 'image')} to train on" + (
        f" from {counted(places, 'place')}" if places < views else ""
    )
    advice = "Take more photos: 50 to 150 around a thing, each overlapping the next by two thirds"
    if viewpoints.stand_still:
        advice = "Add cameras between them, or expect good views near the cameras only"
    elif places < len(_trained_places(survey)) and survey.scene.num_times < 2:
        # Views of panoramas, and no images that are there twice.
        advice = "Take panoramas or photos from more places, a step or two apart"
    # A static capture with every image twice still has too few; a moving camera has enough.
    enough = places if viewpoints.stand_still or survey.scene.num_times < 2 else views
    if views < FEWEST_VIEWS or enough < 2:
        yield Finding(
            "few views",
            Weight.STOP,
            f"{what}.",
            "So few images fit almost any shape.",
            f"{advice}; or hold out fewer (holdout_every=0).",
        )
    elif enough < FEW_VIEWS:
        yield Finding(
            "few views",
            Weight.LIMIT,
            f"{what}.",
            "Views between the trained ones will show floaters and seams.",
            f"{advice}.",
        )
    if viewpoints.trained.all():
        yield Finding(
            "nothing held out",
            Weight.NOTE,
            "All images are trained on.",
            "There will be no held-out figures, so the quality of other views is unknown.",
            "Leave holdout_every at 8, or name images with holdout=NAME,...",
        )


def _trained_places(survey: Survey) -> np.ndarray:
    viewpoints = survey.viewpoints
    return viewpoints.places[viewpoints.trained[viewpoints.places]]


def _different_centers(survey: Survey) -> int:
    """Number of places of trained cameras; the views of a panorama have one."""
    viewpoints = survey.viewpoints
    return len(set(viewpoints.spots[viewpoints.trained[viewpoints.places]]))


def _spread(survey: Survey) -> Iterator[Finding]:
    """True if cameras have moved enough to tell depth."""
    views = int(survey.viewpoints.trained.sum())
    centers = survey.viewpoints.centers[_trained_places(survey)]
    if views < 2:
        return
    offsets = centers - centers.mean(0)
    sizes = np.linalg.svd(offsets, compute_uv=False)
    why = "Depth needs images from different places; turning on the spot gives none."
    advice = "Walk around the scene with the camera instead of turning it."
    if np.linalg.norm(offsets, axis=1).max() < 1e-4:
        found = f"All {views} images were taken from one place."
        yield Finding("no baseline", Weight.STOP, found, why, advice)
        return
    angles = survey.angles
    if angles is not None and np.isfinite(angles.nearest).any() and angles.widest < LINE:
        yield Finding(
            "no baseline" if angles.widest < FLAT else "small baseline",
            Weight.STOP if angles.widest < FLAT else Weight.LIMIT,
            f"The outermost views of a point are {angles.widest:.1f} degrees apart (median).",
            why,
            advice,
        )
    if len(centers) > 2 and len(sizes) > 1 and sizes[1] < STRAIGHT * sizes[0]:
        yield Finding(
            "cameras on a line",
            Weight.LIMIT,
            f"All cameras lie on a line, and leave it by {100 * sizes[1] / sizes[0]:.1f} % "
            "of its length.",
            "Edges along the line show no parallax, and other heights were never seen.",
            "Add a pass at another height.",
        )


def _neighbors(survey: Survey) -> Iterator[Finding]:
    angles, viewpoints = survey.angles, survey.viewpoints
    if angles is None:
        return
    rows = viewpoints.trained[list(angles.places)]
    nearest = angles.nearest[rows]
    views = np.array(angles.places)[rows]
    if len(nearest) < 2:
        return
    # A panorama has neighbours if any of its views has some: others may show a plain wall.
    spots = viewpoints.spots[viewpoints.place_of[views]]
    _, first, spots = np.unique(spots, return_index=True, return_inverse=True)
    alone = np.flatnonzero(np.bincount(spots, np.isfinite(nearest)) == 0)
    if len(alone):
        names = viewpoints.named(views[first[alone]].tolist())
        yield Finding(
            "views without neighbours",
            Weight.LIMIT,
            f"{len(alone)} of {len(first)} places share less than a fifth of what they see with "
            f"any other: {listed(names)}.",
            "The depth of what only one image shows cannot be measured.",
            "Add images between them and the others, or leave them out.",
            names,
        )
    if len(alone) == len(first):
        return
    middle = float(np.nanmedian(nearest))
    if middle > FAR_NEIGHBOR:
        yield Finding(
            "views far apart",
            Weight.LIMIT,
            f"Neighbouring views see the same points {middle:.0f} degrees apart (median).",
            "Surfaces look different from so far apart, and the gaps between are guessed.",
            "Add images between; 5 to 15 degrees apart is usual.",
        )


def _held_out(survey: Survey) -> Iterator[Finding]:
    angles, viewpoints = survey.angles, survey.viewpoints
    if angles is None:
        return
    rows = viewpoints.trained[list(angles.places)]
    held, trained = angles.nearest[~rows], angles.nearest[rows]
    if not np.isfinite(held).any() or not np.isfinite(trained).any():
        return
    far, usual = float(np.nanmedian(held)), float(np.nanmedian(trained))
    if far > max(FAR_HELD_OUT * usual, HELD_OUT_FROM):
        yield Finding(
            "held-out views far away",
            Weight.NOTE,
            f"Held-out views are {far:.0f} degrees from the nearest trained one (median), trained "
            f"ones {usual:.0f} from each other.",
            "Figures then measure views that the training never came near.",
            "Expect lower figures than from every 8th image of one pass.",
        )


def _open_side(survey: Survey) -> Iterator[Finding]:
    """The largest sector around what is looked at from which there is no image."""
    places, viewpoints = _trained_places(survey), survey.viewpoints
    if len(places) < FEWEST_VIEWS:
        return
    centers = viewpoints.centers[places]
    middle = looked_at(centers, viewpoints.axes[places])
    if middle is None:  # A room is seen from inside.
        return
    widest = widest_gap(centers, middle, up_axis(survey.scene, viewpoints)[0])
    if widest > OPEN_SIDE:
        yield Finding(
            "open side",
            Weight.NOTE,
            f"There is no camera in {widest:.0f} of the 360 degrees around what cameras look at.",
            "No image shows the surfaces that can be seen from there, so the model guesses them.",
            "Take photos there if you want to look from there.",
        )


def _leftover_photos(survey: Survey) -> Iterator[Finding]:
    photos = survey.leftovers.photos
    if photos:
        total = len(photos) + len(survey.viewpoints)
        yield Finding(
            "photos without a camera",
            Weight.NOTE,
            f"{len(photos)} of {total} photos have no camera: {listed(photos)}.",
            "They are not trained on; what only they show is missing.",
            "If they belong to the capture, gsfw prepare says why a photo cannot be placed.",
            photos,
        )
