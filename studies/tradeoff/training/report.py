"""Report: trained variants as plain data, as tables, and as offers."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from gsfw.studies.table import Table
from gsfw.studies.tradeoff.recommendation import Offer, Wish
from gsfw.studies.tradeoff.report import USUAL_LOSS
from gsfw.studies.tradeoff.training.trained import (
    COSTS,
    Trained,
    same_psnr,
    spread,
    unbeaten,
)

HEADINGS = (
    *("variant", "steps", "PSNR", "lost dB", "SSIM", "FLIP", "Gaussians", "MB"),
    *("training s", "ms", "peak MB", "front"),
)


def in_order(found: Sequence[Trained]) -> list[Trained]:
    """The baseline first, then variants by their first trial; of each the longest run first."""
    names = list(dict.fromkeys(item.variant for item in found))
    first = [name for name in names if any(i.is_baseline for i in found if i.variant == name)]
    places = {name: place for place, name in enumerate(dict.fromkeys([*first, *names]))}
    return sorted(found, key=lambda item: (places[item.variant], -item.steps))


def yardstick(found: Sequence[Trained]) -> Trained:
    """The baseline's longest run, against which losses are measured."""
    return max((item for item in found if item.is_baseline), key=lambda item: item.steps)


def is_tie(item: Trained, found: Sequence[Trained]) -> bool:
    """True if a variant differs from the baseline by no more than seeds do."""
    return abs(yardstick(found).psnr - item.psnr) <= same_psnr(found)


def documents(found: Sequence[Trained]) -> list[dict[str, Any]]:
    """Plain data of every variant."""
    fronts, first = _fronts(found), yardstick(found)
    return [
        {
            "name": item.variant,
            "axes": list(item.axes),
            "steps": item.steps,
            "changed": dict(item.changed),
            "psnr": item.psnr,
            "ssim": item.ssim,
            "flip": item.flip,
            "psnr_lost": first.psnr - item.psnr,
            "is_tie": is_tie(item, found),
            "psnr_other_seed": item.again,
            "num_gaussians": item.num_gaussians,
            "floats": item.floats,
            "file_mb": item.file_mb,
            "model_bytes": item.model_bytes,
            "train_seconds": item.train_seconds,
            "train_seconds_other_seed": item.seconds_again,
            "render_ms": item.draw_ms,
            "render_ms_spread": item.draw_spread_ms,
            "peak_memory_mb": item.peak_memory_mb,
            "on_front": [cost for cost in COSTS if item.name in fronts[cost]],
            "command": shlex.join(["train", *item.words]),
        }
        for item in in_order(found)
    ]


def metrics(item: Trained, found: Sequence[Trained]) -> dict[str, float | None]:
    """Figures for TensorBoard's HParams page."""
    return {
        "psnr": item.psnr,
        "ssim": item.ssim,
        "flip": item.flip,
        "psnr_lost": yardstick(found).psnr - item.psnr,
        "megabytes": item.file_mb,
        "num_gaussians": item.num_gaussians,
        "train_seconds": item.train_seconds,
        "render_ms": item.draw_ms,
        "peak_memory_mb": item.peak_memory_mb,
    }


def offers(found: Sequence[Trained]) -> list[Offer]:
    """The variants as offers."""
    return [
        Offer(
            name=item.name,
            psnr=item.psnr,
            megabytes=item.file_mb,
            ms=item.draw_ms,
            ms_spread=item.draw_spread_ms,
            command=shlex.join(["gsfw", "train", *item.words]),
            seconds=item.train_seconds,
        )
        for item in found
    ]


def usual_wish(found: Sequence[Trained]) -> tuple[Wish, str]:
    """The wish of a user who asks for nothing, and its words."""
    least = max(USUAL_LOSS, same_psnr(found))
    words = f"a loss of at most {least:.2f} dB against the baseline"
    return Wish(psnr=yardstick(found).psnr - least), words


def table(found: Sequence[Trained], title: str = "") -> Table:
    """A row for each variant."""
    fronts, shown = _fronts(found), ""
    rows = []
    for item in in_order(found):
        peak = item.peak_memory_mb
        rows.append(
            [
                "" if item.variant == shown else item.variant,
                f"{item.steps:,}",
                f"{item.psnr:.2f}",
                _loss(item, found),
                f"{item.ssim:.4f}",
                "" if item.flip is None else f"{item.flip:.4f}",
                f"{item.num_gaussians:,}",
                f"{item.file_mb:.2f}",
                f"{item.train_seconds:.0f}",
                "" if item.draw_ms is None else f"{item.draw_ms:.1f} ± {item.draw_spread_ms:.1f}",
                "" if peak is None else f"{peak:.0f}",
                ", ".join(cost for cost in COSTS if item.name in fronts[cost]),
            ]
        )
        shown = item.variant
    return Table(HEADINGS, rows, title)


def spread_text(found: Sequence[Trained]) -> str:
    """A sentence on the differences of PSNR between seeds."""
    known = spread(found)
    pairs = sum(item.again is not None for item in found)
    if known is None:
        return (
            "No variant was trained with a second seed, so how far PSNR differs between seeds is "
            "not known: small differences may be chance."
        )
    return (
        f"Between seeds PSNR has a standard deviation of {known:.2f} dB ({pairs} of the variants "
        f"with two): differences up to {same_psnr(found):.2f} dB are ties."
    )


def _loss(item: Trained, found: Sequence[Trained]) -> str:
    first = yardstick(found)
    if item == first:
        return ""
    return "tie" if is_tie(item, found) else f"{first.psnr - item.psnr:.2f}"


def _fronts(found: Sequence[Trained]) -> Mapping[str, set[str]]:
    return {cost: {point.name for point in unbeaten(found, cost)} for cost in COSTS}
