"""A model's figures in words."""

from __future__ import annotations

import math
from collections.abc import Iterator

from gsfw.preparation.diagnosis.model_figures import CameraFigures, ModelFigures


def words_of(figures: ModelFigures, given: int) -> Iterator[str]:
    """Sentences.

    Args:
        figures: of the largest model.
        given: how many pictures there were to place.
    """
    yield (
        f"{figures.registered} of {given} pictures were placed; {figures.points:,} points were "
        f"found in {figures.observations:,} places."
    )
    if not figures.points:
        return
    worst = max(figures.errors, key=lambda name: figures.errors[name])
    yield (
        f"The mean reprojection error is {figures.error:.2f} pixels; {worst} has the largest, "
        f"{figures.errors[worst]:.2f}."
    )
    tracks, baselines = figures.tracks, figures.baselines
    yield (
        f"A point is seen by {tracks.mean_length:.1f} pictures (mean), "
        f"{100 * tracks.share_of_pairs:.0f} % of them by two only, within an angle of "
        f"{tracks.median_degrees:.1f} degrees (median; a tenth within less than "
        f"{tracks.low_degrees:.1f})."
    )
    if math.isfinite(baselines.to_depth):
        yield (
            f"From one camera to the nearest it is {baselines.to_depth:.2f} of the depth of what "
            f"they see, and a turn of {baselines.degrees:.0f} degrees (medians)."
        )
    if math.isfinite(baselines.cloud_to_spread):
        yield (
            f"The points take up {baselines.cloud_to_spread:.1f} times the room that the cameras "
            "do."
        )
    yield from map(_camera, figures.cameras)


def _camera(camera: CameraFigures) -> str:
    guess = ""
    if camera.first_focal is not None:
        origin = {"EXIF": "EXIF says", "given": "it was given as"}
        guess = f"; {origin.get(camera.focal_origin, 'the usual guess was')}"
        guess += f" {camera.first_focal:.0f}"
    pictures = f"{camera.pictures} picture{'' if camera.pictures == 1 else 's'}"
    return (
        f"Camera {camera.number} ({camera.model}, {pictures}) has a focal length of "
        f"{camera.focal:.0f} pixels, {camera.view_degrees:.0f} degrees across{guess}."
    )
