"""Findings about points: number, copies, outliers, scale, visibility and colours."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsfw.core.maths.focus import CAMERA_CLEARANCE
from gsfw.core.words import listed
from gsfw.preparation.check.agreement import scatter_by_chance
from gsfw.preparation.check.image_findings import is_unlit
from gsfw.preparation.check.lens_findings import spread_groups
from gsfw.preparation.check.point_scale import points_factor
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Weight

FEW_POINTS = 1000
"""Splats start at the points; the shared captures have 12,169 and 25,784, and 50 photos with
1000 points between them have hardly been matched."""
FEW_IN_IMAGE = 50
"""Points in one image: COLMAP registers an image from 30 inliers, so fewer are chance."""
COINCIDENT = 0.1
"""Part of the points that may repeat others: a merge of two models leaves some."""
OUTLIER = 20.0
"""Median distances from the middle beyond which a point is far out; the farthest of the shared
captures is at 6.5."""
MANY_OUTLIERS = 0.02
"""Part of the points that may be: sky and noise of a usual reconstruction."""
AT_CAMERAS = 0.02
"""Part of the points that may be nearer to a camera than ``CAMERA_CLEARANCE`` extents."""
FAR_SCENE, NEAR_SCENE = 50.0, 0.01
"""In extents of the cameras: median distance of the points from the cameras' middle (beyond 50 the
largest angle between views is 2 degrees), and from their own (below 0.01 they are a speck)."""
SCATTER = 0.55
"""``Agreement.scatter``: 0.09 for fox and 0.35 for plush; 0.71 and 0.73 with images shuffled."""
OF_CHANCE = 0.85
"""The same over ``scatter_by_chance``. It is 0.71 and 0.74 for sound captures with a scatter above
``SCATTER``: 6 of 11 images of a castle, 12 of 97 of plush."""


def point_findings(survey: Survey) -> Iterator[Finding]:
    """Everything that points show; a note where there are none."""
    if not len(survey.scene.points):
        yield from _none(survey)
        return
    yield from _number(survey)
    yield from _copies(survey)
    yield from _outliers(survey)
    check = survey.cross_check
    if check.cameras_wrong or check.other_scene:
        return  # Points go with cameras, and so look wrong as well.
    factor = points_factor(survey)
    if factor is not None:
        yield _other_scale(factor)
        return
    yield from _scale(survey)
    yield from _visible(survey)
    yield from _colors(survey)


def _none(survey: Survey) -> Iterator[Finding]:
    looked_at = survey.surface is not None
    where = "look at one point" if looked_at else "do not look at one point"
    advice = "random_region=" + ("object starts there." if looked_at else "surroundings (usual).")
    if survey.scene.has_alpha:
        advice = "nothing is to do, because with alpha they start where the object is."
    yield Finding(
        "no points",
        Weight.NOTE if looked_at else Weight.LIMIT,
        f"There are no points, and the cameras {where}.",
        "Splats start at random, which takes longer and leaves floaters where nothing says that "
        "space is empty.",
        f"Give points if there are any; else {advice}",
    )


def _number(survey: Survey) -> Iterator[Finding]:
    count = len(survey.scene.points)
    if count < FEW_POINTS:
        yield Finding(
            "few points",
            Weight.LIMIT,
            f"There are {count} points.",
            "Splats start there, so most of the scene starts empty.",
            "Look at the reconstruction (were most images registered?), or start at random with "
            "init=random.",
        )


def _copies(survey: Survey) -> Iterator[Finding]:
    points = survey.scene.points.numpy()
    copies = 1 - len(np.unique(points, axis=0)) / len(points)
    if copies > COINCIDENT:
        yield Finding(
            "coincident points",
            Weight.LIMIT,
            f"{100 * copies:.0f} % of the {len(points)} points lie where another does.",
            "They add nothing, and a file that was damaged or merged twice looks like this.",
            "gsfw leaves the copies out; check where the points come from.",
        )


def _outliers(survey: Survey) -> Iterator[Finding]:
    points = survey.scene.points.numpy()
    away = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    far = float((away > OUTLIER * max(float(np.median(away)), 1e-12)).mean())
    if far > MANY_OUTLIERS:
        yield Finding(
            "points far out",
            Weight.LIMIT,
            f"{100 * far:.1f} % of the points are more than {OUTLIER:.0f} median distances from "
            f"the middle, the farthest {away.max() / np.median(away):.0f}.",
            "Splats that start there are huge, and cover what lies before them.",
            "Filter points by track length and reprojection error before export.",
        )
    chosen = points[np.linspace(0, len(points) - 1, min(len(points), 5000)).astype(int)]
    centers = survey.viewpoints.centers[survey.viewpoints.places]
    near = np.zeros(len(chosen), bool)
    for center in centers:
        near |= np.linalg.norm(chosen - center, axis=1) < CAMERA_CLEARANCE
    if near.mean() > AT_CAMERAS:
        yield Finding(
            "points at cameras",
            Weight.LIMIT,
            f"{100 * near.mean():.1f} % of the points lie at a camera.",
            "They are failed triangulations, or the cameras themselves were exported as points.",
            "gsfw leaves them out; filter them by triangulation angle.",
        )


def _other_scale(factor: float) -> Finding:
    nearer = f"{factor:.1f} times as far" if factor > 1 else f"{1 / factor:.1f} times nearer"
    return Finding(
        "points of another scale",
        Weight.LIMIT,
        f"The points lie {nearer} from the cameras {'as' if factor > 1 else 'than'} what "
        "the images show by their matches.",
        "Splats start where nothing is, and have to be found again one by one.",
        "Points and cameras are in different units, or from two exports: take both from one; else "
        "start at random with init=random.",
    )


def _scale(survey: Survey) -> Iterator[Finding]:
    viewpoints = survey.viewpoints
    centers = viewpoints.centers[viewpoints.trained]
    if np.linalg.norm(centers - centers.mean(0), axis=1).max() < 1e-4:
        return
    points = survey.scene.points.numpy()
    spread = float(np.median(np.linalg.norm(points - centers.mean(0), axis=1)))
    size = float(np.median(np.linalg.norm(points - np.median(points, axis=0), axis=1)))
    if spread > FAR_SCENE:
        yield Finding(
            "scene far away",
            Weight.LIMIT,
            f"The points are {spread:.0f} times as far away as the cameras spread (median).",
            "From so far, views hardly differ; or points and cameras are in different units.",
            "Check that points and cameras come from one export; else move the camera more.",
        )
    elif size < NEAR_SCENE:
        yield Finding(
            "scene tiny",
            Weight.LIMIT,
            f"Half of the points lie within {size:.2g} of the cameras' extent.",
            "Points and cameras may be in different units.",
            "Check that points and cameras come from one export.",
        )


def _visible(survey: Survey) -> Iterator[Finding]:
    surface, viewpoints = survey.surface, survey.viewpoints
    assert surface is not None
    # The views of a panorama have one pose: one of a plain wall sees no points, and fits.
    seen = surface.seen_from(viewpoints.spots)
    first = viewpoints.places[np.unique(viewpoints.spots, return_index=True)[1]]
    blind = np.flatnonzero(~seen.any(1))
    per_spot = seen.mean(1) * len(survey.scene.points)
    if len(blind):
        names = viewpoints.named(first[blind].tolist())
        most = 2 * len(blind) > len(seen)
        yield Finding(
            "cameras see no points",
            Weight.STOP if most else Weight.LIMIT,
            f"{len(blind)} of {len(seen)} places see none of the points: {listed(names)}.",
            "Their poses are wrong, or the points belong to another export"
            + (_turned(survey) if most else "")
            + ".",
            "Check axes (OpenCV or OpenGL), and whether poses lead from or to the camera."
            if most
            else "Leave these images out, or reconstruct again.",
            names,
        )
    few = np.flatnonzero((per_spot > 0) & (per_spot < FEW_IN_IMAGE))
    if len(few) and len(survey.scene.points) >= FEW_POINTS:
        names = viewpoints.named(first[few[np.argsort(per_spot[few])]].tolist())
        yield Finding(
            "few points in images",
            Weight.LIMIT,
            f"{len(few)} places see fewer than {FEW_IN_IMAGE} points: {listed(names)}.",
            "Such poses rest on chance, and what they show starts empty.",
            "Look at these images: plain walls, blur, or another scene?",
            names,
        )


def _turned(survey: Survey) -> str:
    """True if cameras would see points if they looked the other way."""
    surface, viewpoints = survey.surface, survey.viewpoints
    assert surface is not None
    places = viewpoints.places
    offsets = surface.points[None] - viewpoints.centers[places][:, None]
    behind = (offsets * viewpoints.axes[places][:, None]).sum(2) < 0
    share = float(behind.mean())
    return f"; {100 * share:.0f} % of the points are behind the cameras" if share > 0.5 else ""


def _colors(survey: Survey) -> Iterator[Finding]:
    agreement = survey.agreement
    unlit = any(is_unlit(image) for image in survey.sample.images)
    if unlit or spread_groups(survey) or len(survey.cross_check.misplaced):
        return  # That is why.
    if agreement is not None and agreement.scatter > SCATTER:
        chance = scatter_by_chance(survey.surface, survey.viewpoints, survey.sample)
        if agreement.scatter < OF_CHANCE * chance:
            return
        yield Finding(
            "images contradict points",
            Weight.LIMIT,
            f"The colour of a point differs between images by {100 * agreement.scatter:.0f} % "
            f"of what different points differ by ({agreement.points} points).",
            "Poses, focal length or order of the images are probably wrong, or most of the "
            "scene shines or moves.",
            "Draw some points over an image; reconstruct again if they lie elsewhere.",
        )
