"""Findings about lenses: fields of view, focal lengths of one lens, against EXIF, and pixels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsfw.core.cameras import CameraModel
from gsfw.core.words import listed, uncapitalized
from gsfw.preparation.check.lens_groups import LensGroup
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Weight
from gsfw.preparation.parallel_views import GIVE_FOCAL, PARALLEL, view_spread

NARROW, WIDE = 20.0, 120.0
"""Degrees across: a phone has 60 to 75, its telephoto 25, its widest 115; a focal length that was
guessed, or written for another image size, lands outside."""
SPREAD = 1.1
"""Largest by least focal length of images of one lens: autofocus moves it by some per cent, a zoom
or a failed calibration by more."""
AGAINST_EXIF = 0.25
"""Part by which a focal length may differ from EXIF's: 35 mm equivalents are rounded, some tools
crop, and video is cropped by up to a fifth."""
SQUARE = 0.05
"""Pixels of cameras are square to a per cent; 16:9 squeezed into 4:3 is off by a third."""
FEWEST = 4
"""Images without which the shape of pixels and the spread of focal lengths are left to chance;
``gsfw prepare`` reports the few images themselves."""
ALIKE = 0.02
"""Part by which that ratio may differ between images that were stretched alike."""
ONE_CAMERA = (
    "Compute the cameras again with one focal length for all: "
    "gsfw prepare IMAGES out=DIR cameras=one camera_model=SIMPLE_RADIAL."
)


def lens_findings(survey: Survey) -> Iterator[Finding]:
    """All findings about intrinsics."""
    yield from _fields_of_view(survey)
    yield from _focals(survey)
    yield from _against_exif(survey)
    yield from _pixels(survey)


def spread_groups(survey: Survey) -> tuple[LensGroup, ...]:
    """Lenses whose images have focal lengths that differ."""
    return tuple(
        group
        for group in survey.lenses
        if group.focals[:, 0].max() > SPREAD * group.focals[:, 0].min()
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
            f"{len(odd)} of {len(viewpoints)} images have a field of view of "
            f"{angles[odd].min():.0f} to {angles[odd].max():.0f} degrees across the width: "
            f"{listed(names)}.",
            "Hardly any camera has that; the focal length may be wrong, and then nothing fits.",
            "Compare it with the camera's, and with the size of the images it was given for.",
            names,
        )


def _focals(survey: Survey) -> Iterator[Finding]:
    for group in spread_groups(survey):
        if len(group.views) < FEWEST:
            continue
        focals = group.side * group.focals[:, 0]
        usual = np.median(focals)
        order = np.argsort(-np.abs(np.log(focals / usual)))
        names = survey.viewpoints.named(group.views[order].tolist())
        taken = "of one size"
        if group.exif is not None:
            model = " ".join(part for part in (group.exif.make, group.exif.model) if part)
            taken = f"that {model or 'one camera'} took at one setting by EXIF"
        yield Finding(
            "focal lengths differ",
            Weight.LIMIT,
            f"{len(focals)} images {taken} have focal lengths of {focals.min():.0f} to "
            f"{focals.max():.0f} pixels (median {usual:.0f}); farthest off: {listed(names[:3])}.",
            "If one camera took them without zoom, the reconstruction has bent space to fit.",
            ONE_CAMERA,
            names,
        )


def _against_exif(survey: Survey) -> Iterator[Finding]:
    for group in survey.lenses:
        told = group.exif_focal
        usual = float(np.median(group.focals[:, 0]))
        if told is not None and abs(np.log(usual / told)) > np.log(1 + AGAINST_EXIF):
            yield Finding(
                "focal length against EXIF",
                Weight.NOTE,
                f"The focal length of {len(group.views)} images is {group.side * usual:.0f} "
                f"pixels, but {group.side * told:.0f} by EXIF.",
                "Unless images were cropped, the calibration has failed, and space is bent.",
                ONE_CAMERA,
                survey.viewpoints.named(group.views.tolist()),
            )


def _pixels(survey: Survey) -> Iterator[Finding]:
    viewpoints = survey.viewpoints
    ratios = viewpoints.intrinsics[:, 0, 0] / viewpoints.intrinsics[:, 1, 1]
    odd = np.flatnonzero(np.abs(ratios - 1) > SQUARE)
    if not len(odd) or len(viewpoints) < FEWEST:
        return
    names = viewpoints.named(odd.tolist())
    low, high = float(ratios[odd].min()), float(ratios[odd].max())
    # A simpler lens does not help parallel views: 400 pixels came out as 1238, and then as 2875.
    remedy = GIVE_FOCAL if view_spread(viewpoints.axes) < PARALLEL else ONE_CAMERA
    if high > (1 + ALIKE) * low or len(odd) < len(viewpoints):
        found = f"{low:.2f} to {high:.2f} times as high as wide, each image's otherwise."
        why = "One camera has pixels of one shape: the calibration could not tell it, and has bent"
        why, advice = f"{why} space to fit.", remedy
    else:
        found = f"{low:.3f} times as high as wide."
        why = "Cameras have square pixels: images were stretched, or the calibration has failed."
        advice = f"If images were not stretched: {uncapitalized(remedy)}"
    yield Finding(
        "pixels not square",
        Weight.LIMIT,
        f"Pixels of {len(odd)} of {len(viewpoints)} images are {found}",
        why,
        advice,
        names,
    )
