"""Plot of requirements: the floats of a model by purpose, and what each purpose is worth."""

from __future__ import annotations

import torch
from jaxtyping import UInt8
from torch import Tensor

from gsfw.charts.census import Census, CensusRow, census_figure
from gsfw.charts.style import BLUES, FAINTER, SERIES, pixels
from gsfw.core.loop.requirements import Requirements
from gsfw.core.words import brief
from gsfw.studies.requirements.census import BAND, TIME
from gsfw.studies.requirements.sentences import decibels, percent


def plot(requirements: Requirements) -> UInt8[Tensor, "h w 3"]:
    """The census of a model as an image."""
    return torch.from_numpy(pixels(census_figure(census(requirements))))


def census(requirements: Requirements) -> Census:
    """Floats by group with the PSNR that each group is worth; Gaussians by SH degree and step."""
    kind = "held-out" if requirements.split == "eval" else "training"
    degrees = requirements.rows_by_degree
    total = max(sum(degrees), 1)
    return Census(
        title=f"{brief(requirements.total_floats, 3)} floats in {requirements.num_gaussians:,} "
        f"Gaussians; PSNR {requirements.psnr:.2f} dB on {len(requirements.views)} {kind} views",
        counts="floats by purpose",
        worths="PSNR lost without it",
        rows=[*_groups(requirements), *_others(requirements)],
        shares_title="Gaussians by SH degree",
        shares=[
            (f"degree {degree}", count, f"{count:,}, {percent(count / total)}")
            for degree, count in enumerate(degrees)
        ],
        curve_title="Gaussians by step",
        curve=growth(requirements),
    )


def growth(requirements: Requirements) -> list[tuple[float, float]]:
    """Steps and numbers of Gaussians; empty if the strategy reports no such curve."""
    points = requirements.strategy.get("curve", [])
    return [
        (float(point["step"]), float(point["num_gaussians"]))
        for point in points
        if "step" in point and "num_gaussians" in point
    ]


def _groups(requirements: Requirements) -> list[CensusRow]:
    """The groups of floats; SH bands are blue."""
    total, rows = max(requirements.total_floats, 1), []
    others = iter(SERIES[1:] * 9)
    for group in requirements.groups:
        is_band = group.name.startswith(BAND)
        color = BLUES[int(group.name[len(BAND) :])] if is_band else next(others)
        note = f"{brief(group.floats, 3)} floats, {percent(group.floats / total)}"
        rows.append(_row(group.name, color, group.floats, note, group.bought_db))
    return rows


def _others(requirements: Requirements) -> list[CensusRow]:
    """Ablations that are no group of floats: motion, and the least useful Gaussians."""
    rows, motion = [], requirements.motion
    if motion is not None and all(group.name != TIME for group in requirements.groups):
        note = f"rendered as at time {motion.time:g} throughout"
        rows.append(_row("change with time", FAINTER, 0, note, motion.bought_db))
    for item in requirements.least_useful:
        note = f"{percent(item.contribution)} of the contribution"
        name = f"the least useful {percent(item.part)}"
        rows.append(_row(name, FAINTER, 0, note, item.bought_db))
    return rows


def _row(name: str, color: str, count: int, note: str, worth: float | None) -> CensusRow:
    return CensusRow(name, color, count, note, worth, "" if worth is None else decibels(worth))
