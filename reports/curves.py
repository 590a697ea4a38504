"""Curves: how training went, and quality over the time of a moving scene."""

from __future__ import annotations

from gsfw.core.loop.baselines import NAMES
from gsfw.reports.chart import Chart, Curve, Point, smoothed
from gsfw.reports.markup import Markup, div, join, section
from gsfw.reports.run_record import RunRecord, listed, number

FEW = 20
"""Logged steps up to which raw values are shown without a mean over neighbours."""


def training_section(record: RunRecord) -> Markup:
    """Loss, PSNR and number of Gaussians over the steps."""
    charts = [loss_chart(record), psnr_chart(record), count_chart(record)]
    drawn = [chart.markup() for chart in charts]
    if not any(drawn):
        return section("training", "Training", "No step was logged.")
    lead = "Pale: the training image of each logged step. Bold: the mean over neighbouring steps."
    return section("training", "Training", div("charts", drawn), lead)


def loss_chart(record: RunRecord) -> Chart:
    """The loss; logarithmic, since it falls by orders of magnitude."""
    points = record.series("loss")
    is_ratio = bool(points) and min(value for _, value in points) > 0
    return Chart("Loss", "step", _raw_and_mean(points), is_ratio=is_ratio)


def psnr_chart(record: RunRecord) -> Chart:
    """PSNR of training images and of held-out ones, above the level of one colour."""
    curves = list(_raw_and_mean(record.series("psnr")))
    held_out = record.series("eval/psnr")
    curves.append(Curve("held-out views", held_out, 1, "dots"))
    level = record.baseline("constant_psnr")
    steps = [x for curve in curves for x, _ in curve.points]
    if level is not None and steps:
        ends = ((min(steps), level), (max(steps), level))
        curves.append(Curve(NAMES["constant_psnr"], ends, 5, "dashed"))
    return Chart("PSNR", "step", tuple(curves), unit="dB")


def count_chart(record: RunRecord) -> Chart:
    """Number of Gaussians."""
    curve = Curve("Gaussians", record.series("num_gaussians"), 2)
    return Chart("Gaussians", "step", (curve,), is_from_zero=True)


def time_section(record: RunRecord) -> Markup:
    """PSNR at each time of a moving scene; nothing for a static one."""
    chart = time_chart([record])
    if chart is None:
        return join(())
    protocol = record.protocol.get("moving_region")
    lead = f"Moving region: {protocol}." if protocol else ""
    return section("time", "Over time", div("charts one", chart.markup()), lead)


def time_chart(records: list[RunRecord], names: tuple[str, ...] = ()) -> Chart | None:
    """PSNR over time, of all pixels and of moving ones; ``None`` with fewer than two times.

    Args:
        records: the runs.
        names: of the runs in the legend; empty for one run.
    """
    curves = []
    for place, record in enumerate(records):
        prefix = f"{names[place]}: " if names else ""
        for kind, (key, what) in enumerate(
            (("psnr", "all pixels"), ("moving_psnr", "moving pixels"))
        ):
            points = _over_time(record, key)
            color = place if names else kind
            style = "dashed" if names and kind else "dots"
            if len(points) > 1:
                curves.append(Curve(f"{prefix}{what}", points, color, style))
    if not curves:
        return None
    return Chart(
        "PSNR of held-out views over time", "time, in the data's unit", tuple(curves), unit="dB"
    )


def _over_time(record: RunRecord, key: str) -> list[Point]:
    points = []
    for item in listed(record.evaluation, "over_time"):
        time, value = number(item.get("data_time")), number(item.get(key))
        if time is not None and value is not None:
            points.append((time, value))
    return points


def _raw_and_mean(points: list[Point]) -> tuple[Curve, ...]:
    """Values of the training images of single steps, pale, and their mean over neighbours."""
    name = "training image"
    if len(points) <= FEW:
        return (Curve(name, points, 0),)
    return (Curve(name, points, 0, "faint"), Curve(name, smoothed(points), 0))
