"""Measure: the requirements of a trained run."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from gsfw.core.datamanager import Split
from gsfw.core.loop.requirements import FloatGroup, Requirements
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.studies.requirements.census import BAND, TIME, Census, band_name
from gsfw.studies.requirements.sentences import could_go, headline, left_out
from gsfw.studies.requirements.worth import MOST_CAMERAS, Worth
from gsfw.studies.tradeoff.subject import Subject

WITHOUT_BAND = "PSNR with this band and those below it, less PSNR with those below it alone."
UNUSED_BAND = "Training ended before this band was rendered."
HELD_STILL = (
    "PSNR as it is, less PSNR with every view rendered as the model is at time {:g} of 0 to 1."
)
PROTOCOL = (
    "PSNR is the mean over the views below, of the finished model with something left out; nothing "
    "was trained anew, which would make up for a part of it. The least useful Gaussians are those "
    f"that add the least alpha times transmittance to up to {MOST_CAMERAS} training views."
)
NEEDED = "Not measured: there is no image without them."
OTHERS = "Not measured: gsfw does not know how to render this model without them."
ALWAYS = ("positions", "rotations and sizes", "opacities", band_name(0))
"""Groups that every Gaussian needs."""


def measure(
    parts: TrainingParts, plan: TrainingPlan, step: int, settings: Mapping[str, Any]
) -> Requirements:
    """Count the floats of a finished model, and render it without some of them.

    Nothing of the run is changed: neither its model, nor its optimizer, nor its generator.

    Args:
        parts: of the run.
        plan: of the run.
        step: after which the model is finished.
        settings: of the run, as plain data by dotted key.

    Raises:
        DataError: an image does not decode.
    """
    started = time.perf_counter()
    subject = Subject(
        parts.model, parts.rasterizer, plan.settings, is_still=not parts.data.scene.is_dynamic
    )
    census = Census.of(parts.model, parts.optimizer, settings.get("sh_degree"))
    worth = Worth.of(subject, parts.data, parts.device)
    return Requirements(
        step=step,
        num_gaussians=parts.model.num_rows,
        groups=tuple(_group(name, count, worth) for name, count in census.floats.items()),
        sh_floats=census.sh_floats,
        sh_floats_full=census.sh_floats_full,
        rows_by_degree=census.rows_by_degree,
        training_floats=census.for_training,
        views=worth.views,
        split=worth.split.value,
        protocol=PROTOCOL,
        psnr=worth.psnr,
        least_useful=worth.least_useful,
        motion=worth.motion,
        num_times=parts.data.scene.num_times,
        headline=headline(census, worth, settings, parts.model.num_rows),
        left_out=left_out(census, parts.model.num_rows),
        could_go=could_go(census, worth, settings),
        not_measured=_not_measured(worth),
        strategy=parts.refiners.report(),
        method=parts.method.report(),
        seconds=time.perf_counter() - started,
    )


def _group(name: str, floats: int, worth: Worth) -> FloatGroup:
    if name == TIME and worth.motion is not None:
        how = HELD_STILL.format(worth.motion.time)
        return FloatGroup(name, floats, worth.motion.bought_db, how)
    for band, db in enumerate(worth.bands, start=1):
        if name == band_name(band):
            return FloatGroup(name, floats, db, WITHOUT_BAND)
    if name in ALWAYS:
        return FloatGroup(name, floats, None, NEEDED)
    if name.startswith(BAND):
        return FloatGroup(name, floats, 0.0, UNUSED_BAND)
    return FloatGroup(name, floats, None, OTHERS)


def _not_measured(worth: Worth) -> tuple[str, ...]:
    found = []
    if worth.split is Split.TRAIN:
        found.append("No view is held out: PSNR is that of views the model was trained on.")
    if not worth.least_useful:
        found.append("The rasterizer does not measure the contribution of each Gaussian.")
    return tuple(found)
