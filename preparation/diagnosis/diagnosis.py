"""Diagnosis: what became of every image, how good the model is, and what to do about it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gsfw.core.words import counted
from gsfw.preparation.camera_grouping import PANORAMA, CameraGroup
from gsfw.preparation.diagnosis.camera_findings import camera_findings, focal_findings
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.match_graph import Bridge, Component
from gsfw.preparation.diagnosis.model_figures import CameraFigures, ModelFigures
from gsfw.preparation.diagnosis.registration_findings import registration_findings
from gsfw.preparation.diagnosis.unregistered import Unregistered
from gsfw.preparation.diagnosis.view_findings import repetition_findings, view_findings
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.finding import Finding, Verdict, sorted_findings
from gsfw.preparation.image_set import ImageSet, LeftOut
from gsfw.preparation.mapping.mapping import Mapping as CameraMapping

JUDGES = (
    focal_findings,
    repetition_findings,
    registration_findings,
    view_findings,
    camera_findings,
)

MOST_CAMERAS = 5
"""Cameras that have a sentence each: ``cameras=per-image`` makes as many as there are images."""


@dataclass(frozen=True)
class Diagnosis:
    """All that is to be said before the written data set is looked at."""

    given: int
    """Number of images, including those that do not decode."""
    registered: tuple[str, ...]
    """Images that the largest model has, in the order of the set."""
    unregistered: tuple[Unregistered, ...]
    """All other photos, and panoramas, each with its reason."""
    left_out: tuple[LeftOut, ...]
    """Files that are no images of the set, each with its reason."""
    components: tuple[Component, ...]
    """Groups of images that match, the one with most placed images first."""
    bridges: tuple[Bridge, ...]
    """The nearest pair of each other component and those before it."""
    model: ModelFigures | None
    """``None`` where no camera was placed."""
    figures: tuple[str, ...]
    """The same in words; empty without."""
    findings: tuple[Finding, ...]
    """The gravest first."""

    @property
    def verdict(self) -> Verdict:
        """The verdict of the gravest finding."""
        return Verdict.of(self.findings)

    def document(self) -> dict[str, Any]:
        """Plain data; without the findings, which are reported with those of ``gsfw check``."""
        return {
            "given": self.given,
            "registered": list(self.registered),
            "unregistered": [item.document() for item in self.unregistered],
            "left_out": [
                {"name": item.name, "reason": item.reason, "advice": item.advice}
                for item in self.left_out
            ],
            "groups": [component.document() for component in self.components],
            "bridges": [bridge.document() for bridge in self.bridges],
            "model": self.model.document() if self.model is not None else None,
            "figures": list(self.figures),
        }


def diagnose(
    database: Path,
    images: ImageSet,
    groups: Sequence[CameraGroup],
    features: Mapping[str, FeatureReport],
    mapping: CameraMapping,
) -> Diagnosis:
    """Look at what all stages have left behind; nothing is computed anew.

    Args:
        database: COLMAP's, with features and matches.
        images: all of them.
        groups: their cameras.
        features: what is known of each image.
        mapping: its models; there may be none.

    Raises:
        DataError: the database or a model cannot be read.
    """
    evidence = Evidence.gather(database, images, groups, features, mapping.models)
    figures = evidence.figures
    return Diagnosis(
        given=evidence.given,
        registered=evidence.registered,
        unregistered=evidence.unregistered,
        left_out=images.left_out,
        components=evidence.components,
        bridges=evidence.bridges,
        model=figures,
        figures=(*words_of(figures, evidence.given), *_on_views(evidence)) if figures else (),
        findings=sorted_findings(finding for judge in JUDGES for finding in judge(evidence)),
    )


def _on_views(evidence: Evidence) -> Iterator[str]:
    """The sentence on views of panoramas, where there are any."""
    images = evidence.images
    views = [image for image in images.images if image.view is not None]
    if views:
        count = evidence.count_shots(image.name for image in views)
        placed = evidence.count_shots({image.name for image in views} & {*evidence.registered})
        focals = sorted({image.view.focal for image in views if image.view is not None})
        yield (
            f"{len(views)} of {len(images.images)} images are views of "
            f"{counted(count, 'panorama')}, of which {placed} {'was' if placed == 1 else 'were'} "
            f"placed; the focal length of {_numbers(focals)} pixels is exact."
        )


def _numbers(values: Sequence[float]) -> str:
    return " or ".join(f"{value:.0f}" for value in values)


def words_of(figures: ModelFigures, given: int) -> Iterator[str]:
    """Sentences.

    Args:
        figures: of the largest model.
        given: how many images there were to place.
    """
    yield (
        f"{figures.registered} of {given} images were placed; {figures.points:,} points were "
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
        f"A point is seen by {tracks.mean_length:.1f} images (mean), "
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
        yield (f"The points extend {baselines.cloud_to_spread:.1f} times as far as the cameras do.")
    cameras = [camera for camera in figures.cameras if camera.focal_origin != PANORAMA]
    if len(cameras) > MOST_CAMERAS:
        focals = [camera.focal for camera in cameras]
        yield (
            f"{len(focals)} cameras have focal lengths of {min(focals):.0f} to {max(focals):.0f} "
            "pixels; prepare.json lists them."
        )
    else:
        yield from map(_camera, cameras)


def _camera(camera: CameraFigures) -> str:
    guess = ""
    if camera.first_focal is not None:
        origin = {"EXIF": "EXIF says", "given": "it was given as"}
        guess = f"; {origin.get(camera.focal_origin, 'the usual guess was')}"
        guess += f" {camera.first_focal:.0f}"
    images = counted(camera.images, "image")
    return (
        f"Camera {camera.number} ({camera.model}, {images}) has a focal length of "
        f"{camera.focal:.0f} pixels, a field of view of {camera.view_degrees:.1f} degrees across "
        f"the width{guess}."
    )
