"""Report of `gsfw check`: a document for programs, and its rows and sentences for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from gsfw.core.errors import DataError
from gsfw.datamanagers.description import with_counts
from gsfw.preparation.check.examination import Examination
from gsfw.preparation.check.plan import Plan, plain_background
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.check.time_findings import cameras_at_times, still_share
from gsfw.preparation.check.track_colors import MIN_VIEWS
from gsfw.preparation.check.view_dependence import MIN_POINTS
from gsfw.preparation.finding import Finding, Verdict, Weight

MILLION = 1_000_000
WEIGHTS = {"stop": "Will not train", "limit": "Limit", "note": "Note"}
"""First words of the sentence about a finding, by its weight."""


def report(examined: Examination, plan: Plan) -> dict[str, Any]:
    """The document of a data set that can be opened, without its path, command and sheet."""
    return {
        "verdict": Verdict.of(examined.findings).value,
        **describe(examined.survey, plan),
        "notes": list(examined.notes),
        "findings": [finding.document() for finding in examined.findings],
    }


def report_unreadable(error: DataError) -> dict[str, Any]:
    """The document of a data set whose format is recognised and that cannot be opened."""
    finding = Finding(
        kind="cannot be read",
        weight=Weight.STOP,
        found=error.message,
        why="Training ends with this error.",
        advice=error.advice or "See gsfw info, and docs/guides/data.md for what a format needs.",
    )
    return {"verdict": Verdict.of([finding]).value, "findings": [finding.document()]}


def describe(survey: Survey, plan: Plan) -> dict[str, Any]:
    """Figures of a survey as plain data."""
    viewpoints, scene, sample = survey.viewpoints, survey.scene, survey.sample
    return {
        "views_train": int(viewpoints.trained.sum()),
        "views_eval": int((~viewpoints.trained).sum()),
        "places": len(viewpoints.places),
        "cameras": len(np.unique(viewpoints.physical)),
        "image_sizes": with_counts(f"{width}x{height}" for width, height in viewpoints.sizes),
        "camera_models": with_counts(camera.model.value for camera in viewpoints.cameras),
        "field_of_view": _range(viewpoints.fields_of_view),
        "points": len(scene.points),
        "visible_share": _visible_share(survey),
        "neighbor_angle": _neighbor_angle(survey),
        "widest_angle": None if survey.angles is None else round(survey.angles.widest, 1),
        "color_scatter": None if survey.agreement is None else round(survey.agreement.scatter, 3),
        "alpha": scene.has_alpha,
        "covered": _mean([image.covered for image in sample.images]),
        "valid": _mean([image.valid for image in sample.images]),
        "background": plain_background(survey),
        "tracked_points": len(survey.track_colors.rows),
        "view_dependence": _view_dependence(survey),
        **_times(survey),
        "images_decoded": sample.tried,
        "images": sample.total,
        "methods": list(plan.methods),
        "decoded_mb": round(plan.decoded_mb, 1),
        "cache_mb": plan.cache_mb,
        "gaussians": plan.gaussians,
        "gaussians_mb": round(plan.megabytes(plan.gaussians), 1),
        "million_gaussians_mb": round(plan.megabytes(MILLION), 1),
    }


def _view_dependence(survey: Survey) -> dict[str, Any] | None:
    return None if survey.view_dependence is None else survey.view_dependence.document()


def _times(survey: Survey) -> dict[str, Any]:
    if survey.scene.num_times < 2:
        return {"times": survey.scene.num_times}
    share = still_share(survey)
    return {
        "times": survey.scene.num_times,
        "time_range": list(survey.scene.time_range or ()),
        "cameras_at_each_time": cameras_at_times(survey.viewpoints),
        "still_share": None if share is None else round(share, 3),
    }


def _range(values: np.ndarray) -> list[float]:
    known = values[np.isfinite(values)]
    return (
        sorted({round(float(known.min()), 1), round(float(known.max()), 1)}) if len(known) else []
    )


def _mean(values: list[float]) -> float | None:
    return round(float(np.mean(values)), 3) if values else None


def _visible_share(survey: Survey) -> float | None:
    """Part of the points that is in an image, as a median."""
    if survey.surface is None or not survey.surface.measured:
        return None
    return round(float(np.median(survey.surface.seen.mean(1))), 3)


def _neighbor_angle(survey: Survey) -> float | None:
    """Degrees between neighbouring trained views, as a median."""
    if survey.angles is None:
        return None
    rows = survey.viewpoints.trained[list(survey.angles.places)]
    nearest = survey.angles.nearest[rows]
    return round(float(np.nanmedian(nearest)), 1) if np.isfinite(nearest).any() else None


def finding_lines(finding: Mapping[str, Any]) -> Iterator[str]:
    """Lines for people on one finding, given as plain data: with its reason and advice."""
    yield ""
    yield f"{WEIGHTS[finding['weight']]} - {finding['kind']}: {finding['found']}"
    yield f"  {finding['why']}"
    yield f"  {finding['advice']}"


def verdict_line(document: Mapping[str, Any]) -> str:
    """The verdict, with the kinds of findings that it follows from."""
    return f"verdict: {document['verdict']}{_summary(document)}"


def _summary(document: Mapping[str, Any]) -> str:
    weights = [finding["weight"] for finding in document["findings"]]
    kinds = [f["kind"] for f in document["findings"] if f["weight"] != "note"]
    if not weights:
        return ": no fault was found"
    return f" ({', '.join(kinds)})" if kinds else ""


def sample_line(document: Mapping[str, Any]) -> str:
    """A sentence on the number of decoded images."""
    tried, total = document["images_decoded"], document["images"]
    if tried == total:
        return f"All {total} images were decoded."
    return (
        f"{tried} of {total} images were decoded, evenly spread (images=all decodes all): "
        "others may be damaged, blurred or copies."
    )


def table_rows(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Names and values of the figures, for a table."""
    rows = [
        (
            "images",
            f"{document['views_train']} to train on, {document['views_eval']} held out, from "
            f"{document['places']} places",
        ),
        ("sizes", "; ".join(document["image_sizes"])),
        ("cameras", f"{document['cameras']}; {'; '.join(document['camera_models'])}"),
        ("field of view", f"{_numbers(document['field_of_view'])} degrees across the width"),
        ("points", _points(document)),
    ]
    if document["neighbor_angle"] is not None:
        angles = f"{document['neighbor_angle']:g} degrees to the next view (median)"
        widest = f"{document['widest_angle']:g} between the outermost of a point"
        rows.append(("angles", f"{angles}, {widest}"))
    rows.append(("pixels", _pixels(document)))
    rows.extend(_view_rows(document))
    if document["times"] > 1:
        rows.append(("times", _time_text(document)))
    return [*rows, ("memory", _memory(document))]


def _numbers(values: list[float]) -> str:
    return " to ".join(f"{value:g}" for value in values) or "no"


def _points(document: Mapping[str, Any]) -> str:
    if not document["points"]:
        return "none"
    share = f"{100 * document['visible_share']:.0f} % of them in an image (median)"
    return f"{document['points']:,}, {share}"


def _pixels(document: Mapping[str, Any]) -> str:
    """Alpha, masks and background."""
    texts = []
    if document["alpha"]:
        texts.append(f"alpha covers {100 * (document['covered'] or 0):.0f} %")
    if (document["valid"] or 0) < 1:
        texts.append(f"masks keep {100 * (document['valid'] or 0):.0f} %")
    if document["background"]:
        texts.append(f"opaque on plain {document['background']}")
    return ", ".join(texts) or "opaque, all count"


def _view_rows(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Rows on the view dependence of the colours of points."""
    found, kind = document["view_dependence"], "view dependence"
    if found is None:
        known = f"{document['tracked_points'] or 'no'} points are known to be in {MIN_VIEWS}"
        return [(kind, f"not measured: {known} of these images or more; it takes {MIN_POINTS}")]
    matte, first, more, chance = (
        f"{100 * found[key]:.0f} %" for key in ("matte", "degree_1", "degree_2", "by_chance")
    )
    return [
        (
            kind,
            f"{matte} of {found['points']:,} points are matte, {first} ask for degree 1, {more} "
            f"for 2 ({chance} by chance); it is worth {sum(found['gain_db']):.1f} dB at the points",
        ),
        (
            "colours",
            f"of a point differ by {found['deviation']:.1f} grey levels, by "
            f"{found['deviation_without_exposure']:.1f} without exposure; errors of its place make "
            f"{found['deviation_if_misplaced']:.1f}",
        ),
    ]


def _time_text(document: Mapping[str, Any]) -> str:
    text = f"{document['times']}, {document['cameras_at_each_time']:g} trained views at each"
    if document["still_share"] is not None:
        text += f"; {100 * document['still_share']:.0f} % of the pixels stand still"
    return f"{text}; methods {', '.join(document['methods'])}"


def _memory(document: Mapping[str, Any]) -> str:
    return (
        f"{document['decoded_mb']:,.0f} MB of images (cache_mb={document['cache_mb']}), "
        f"{document['gaussians']:,} Gaussians to start with take "
        f"{document['gaussians_mb']:,.0f} MB while training, a million of them "
        f"{document['million_gaussians_mb']:,.0f}"
    )
