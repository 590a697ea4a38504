"""What the cameras' lenses say: angles of view, focal lengths, the shape of pixels."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsfw.core.cameras import CameraModel
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Weight, listed

NARROW, WIDE = 20.0, 120.0
"""Degrees across: a phone has 60 to 75, its telephoto 25, its widest 115; a focal length that was
guessed, or written for another picture size, lands outside."""
SPREAD = 1.1
"""Largest by least focal length of pictures of one size from one camera: autofocus moves it by
some per cent, a zoom or a failed calibration by more."""
SQUARE = 0.05
"""Pixels of cameras are square to a per cent; 16:9 squeezed into 4:3 is off by a third."""


def lens_findings(survey: Survey) -> Iterator[Finding]:
    """Everything that intrinsics show."""
    yield from _fields_of_view(survey)
    yield from _focals(survey)
    yield from _pixels(survey)


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
            f"{len(odd)} of {len(viewpoints)} pictures are {angles[odd].min():.0f} to "
            f"{angles[odd].max():.0f} degrees wide: {listed(names)}.",
            "Hardly any camera has that; the focal length may be wrong, and then nothing fits.",
            "Compare it with the camera's, and with the size of the pictures it was given for.",
            names,
        )


def _focals(survey: Survey) -> Iterator[Finding]:
    viewpoints = survey.viewpoints
    for camera in np.unique(viewpoints.physical):
        for size in np.unique(viewpoints.sizes[viewpoints.physical == camera], axis=0):
            mine = (viewpoints.physical == camera) & (viewpoints.sizes == size).all(1)
            focals = viewpoints.intrinsics[mine, 0, 0]
            if focals.max() > SPREAD * focals.min():
                yield _different(f"Pictures of camera {camera}", focals)
    own = len(np.unique(viewpoints.physical)) == len(viewpoints) > 2
    same_size = (viewpoints.sizes == viewpoints.sizes[0]).all()
    focals = viewpoints.intrinsics[:, 0, 0]
    if own and same_size and focals.max() > SPREAD * focals.min():
        yield _different("Every picture has a camera of its own, and they", focals)


def _different(what: str, focals: np.ndarray) -> Finding:
    return Finding(
        "focal lengths differ",
        Weight.LIMIT,
        f"{what} have focal lengths of {focals.min():.0f} to {focals.max():.0f} pixels.",
        "If one camera took them without zoom, the reconstruction has bent space to fit.",
        "Let all pictures share one camera (COLMAP: --ImageReader.single_camera 1).",
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
            f"Pixels of {len(odd)} of {len(viewpoints)} pictures are {ratios[odd[0]]:.3f} times "
            "as high as wide.",
            "Cameras have square pixels; pictures were probably stretched after calibration.",
            "Use the pictures that the cameras were computed from.",
            names,
        )
