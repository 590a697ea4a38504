"""Findings about the cameras: their number, poses, neighbours, focal lengths and pixels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsfw.core.cameras import CameraModel
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Weight, listed

FEWEST_VIEWS = 3
"""With two views every point on a ray that both see fits as well; nothing is redundant."""
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
"""Held-out views are far from trained ones if that angle is so many times what trained views
have between them."""
HELD_OUT_FROM = 5.0
"""Below so many degrees held-out views are near whatever trained ones have between them."""
OPEN_SIDE = 120.0
"""Degrees without a camera around what is looked at: a third of the sides was never seen."""
NARROW, WIDE = 20.0, 120.0
"""Degrees across: a phone has 60 to 75, its telephoto 25, its widest 115; a focal length that was
guessed, or written for another image size, lands outside."""
SPREAD = 1.1
"""Largest by least focal length of images of one size from one camera: autofocus moves it by
some per cent, a zoom or a failed calibration by more."""
SQUARE = 0.05
"""Pixels of cameras are square to a per cent; 16:9 squeezed into 4:3 is off by a third."""


def camera_findings(survey: Survey) -> Iterator[Finding]:
    """All findings about poses and intrinsics."""
    yield from _number(survey)
    yield from _spread(survey)
    yield from _neighbors(survey)
    yield from _held_out(survey)
    yield from _open_side(survey)
    yield from _fields_of_view(survey)
    yield from _focals(survey)
    yield from _pixels(survey)


def _number(survey: Survey) -> Iterator[Finding]:
    viewpoints = survey.viewpoints
    views = int(viewpoints.trained.sum())
    places = _trained_places(survey)
    what = f"{views} images to train on" + (
        f" from {len(places)} places" if len(places) < views else ""
    )
    advice = "Take more photos: 50 to 150 around a thing, each overlapping the next by two thirds"
    if viewpoints.stand_still:
        advice = "Add cameras between them, or be content with views near the cameras"
    # A static capture with every image twice still has too few; a moving camera has enough.
    enough = len(places) if viewpoints.stand_still or survey.scene.num_times < 2 else views
    if views < FEWEST_VIEWS or enough < 2:
        yield Finding(
            "few views",
            Weight.STOP,
            f"{what}.",
            "Any shape along the cameras' rays explains so few images.",
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
            "There will be no held-out figures, so nothing tells how good other views are.",
            "Leave holdout_every at 8, or name images with holdout=NAME,...",
        )


def _trained_places(survey: Survey) -> np.ndarray:
    viewpoints = survey.viewpoints
    return viewpoints.places[viewpoints.trained[viewpoints.places]]


def _spread(survey: Survey) -> Iterator[Finding]:
    """True if cameras have moved enough to tell depth."""
    views = int(survey.viewpoints.trained.sum())
    centers = survey.viewpoints.centers[_trained_places(survey)]
    if views < 2:
        return
    offsets = centers - centers.mean(0)
    sizes = np.linalg.svd(offsets, compute_uv=False)
    why = "Depth is only seen from places apart; turning on the spot shows none."
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
    alone = np.flatnonzero(np.isnan(nearest))
    if len(alone):
        names = viewpoints.named(views[alone].tolist())
        yield Finding(
            "views without neighbours",
            Weight.LIMIT,
            f"{len(alone)} of {len(nearest)} places share less than a fifth of what they see with "
            f"any other: {listed(names)}.",
            "What only one image shows is painted at any depth.",
            "Add images between them and the others, or leave them out.",
            names,
        )
    if len(alone) == len(nearest):
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
    surface = survey.surface
    if surface is None:
        return
    places = _trained_places(survey)
    if len(places) < FEWEST_VIEWS:
        return
    centers = survey.viewpoints.centers[places]
    middle = np.median(surface.points, axis=0)
    inward = ((middle - centers) * survey.viewpoints.axes[places]).sum(1) > 0
    if inward.mean() < 0.9:  # A room is seen from inside.
        return
    offsets = centers - middle
    _, _, axes = np.linalg.svd(offsets - offsets.mean(0), full_matrices=False)
    around = np.sort(np.arctan2(offsets @ axes[1], offsets @ axes[0]))
    gaps = np.diff(np.append(around, around[0] + 2 * np.pi))
    widest = float(np.degrees(gaps.max()))
    if widest > OPEN_SIDE:
        yield Finding(
            "open side",
            Weight.NOTE,
            f"There is no camera in {widest:.0f} of the 360 degrees around the scene.",
            "From there the result shows what no image shows.",
            "If it shall be looked at from there, take photos there.",
        )


def _fields_of_view(survey: Survey) -> Iterator[Finding]:
    viewpoints = survey.viewpoints
    angles = viewpoints.fields_of_view
    pinholes = np.array([c.model is CameraModel.PINHOLE for c in viewpoints.cameras])
    odd = np.flatnonzero(pinholes & ((angles < NARROW) | (angles > WIDE)))
    if len(odd):
        names = viewpoints.named(odd.tolist())
        yield Finding(
            "field of view",
            Weight.LIMIT,
            f"{len(odd)} of {len(viewpoints)} images are {angles[odd].min():.0f} to "
            f"{angles[odd].max():.0f} degrees wide: {listed(names)}.",
            "Hardly any camera has that; the focal length may be wrong, and then nothing fits.",
            "Compare it with the camera's, and with the size of the images it was given for.",
            names,
        )


def _focals(survey: Survey) -> Iterator[Finding]:
    viewpoints = survey.viewpoints
    for camera in np.unique(viewpoints.physical):
        for size in np.unique(viewpoints.sizes[viewpoints.physical == camera], axis=0):
            mine = (viewpoints.physical == camera) & (viewpoints.sizes == size).all(1)
            focals = viewpoints.intrinsics[mine, 0, 0]
            if focals.max() > SPREAD * focals.min():
                yield _different(f"Images of camera {camera}", focals)
    own = len(np.unique(viewpoints.physical)) == len(viewpoints) > 2
    same_size = (viewpoints.sizes == viewpoints.sizes[0]).all()
    focals = viewpoints.intrinsics[:, 0, 0]
    if own and same_size and focals.max() > SPREAD * focals.min():
        yield _different("Every image has a camera of its own, and they", focals)


def _different(what: str, focals: np.ndarray) -> Finding:
    return Finding(
        "focal lengths differ",
        Weight.LIMIT,
        f"{what} have focal lengths of {focals.min():.0f} to {focals.max():.0f} pixels.",
        "If one camera took them without zoom, the reconstruction has bent space to fit.",
        "Let all images share one camera (COLMAP: --ImageReader.single_camera 1).",
    )


def _pixels(survey: Survey) -> Iterator[Finding]:
    viewpoints = survey.viewpoints
    ratios = viewpoints.intrinsics[:, 0, 0] / viewpoints.intrinsics[:, 1, 1]
    odd = np.flatnonzero(np.abs(ratios - 1) > SQUARE)
    if len(odd):
        names = viewpoints.named(odd.tolist())
        yield Finding(
            "pixels not square",
            Weight.LIMIT,
            f"Pixels of {len(odd)} of {len(viewpoints)} images are {ratios[odd[0]]:.3f} times "
            "as high as wide.",
            "Cameras have square pixels; images were probably stretched after calibration.",
            "Use the images that the cameras were computed from.",
            names,
        )
