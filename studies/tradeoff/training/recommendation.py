"""Recommendation: the training command that meets what a user asks for."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from gsfw.studies.tradeoff.front import SAME_PSNR
from gsfw.studies.tradeoff.recommendation import USUAL_LOSS, Recommendation, Wish
from gsfw.studies.tradeoff.training.report import yardstick
from gsfw.studies.tradeoff.training.trained import Trained, same_psnr


def recommend(found: Sequence[Trained], wish: Wish) -> Recommendation:
    """The cheapest variant that meets a wish.

    The smallest file where accuracy is asked for, or nothing is; else the most accurate one, and of
    those that are equal to 0.01 dB the smallest. Of files of one size, the one that is trained in
    less time.

    Args:
        found: variants that were trained, the baseline among them.
        wish: what is asked for.
    """
    asked = str(wish)
    if not asked:
        least = max(USUAL_LOSS, same_psnr(found))
        wish = Wish(psnr=yardstick(found).psnr - least)
        asked = f"a loss of at most {least:.2f} dB against the baseline"
    meeting = [item for item in found if wish.is_met(item.psnr, _ms(item), item.file_mb)]
    if not meeting:
        return Recommendation(f"{asked}: no variant has it.{_nearest(found, wish)}")
    chosen = min(meeting, key=lambda item: _order(item, wish))
    command = shlex.join(["gsfw", "train", *chosen.words])
    return Recommendation(f"For {asked}: {command} ({figures(chosen)}).", command)


def figures(item: Trained) -> str:
    """What a variant has, in few words."""
    parts = [f"{item.psnr:.2f} dB", f"{item.file_mb:.2f} MB"]
    parts += [] if item.draw_ms is None else [f"{item.draw_ms:.1f} ms"]
    return ", ".join([*parts, f"{item.train_seconds:.0f} s of training"])


def _order(item: Trained, wish: Wish) -> tuple[float, ...]:
    if wish.psnr is not None:
        return item.file_mb, item.train_seconds
    return -float(round(item.psnr / SAME_PSNR)), item.file_mb


def _ms(item: Trained) -> float | None:
    """Median and spread together, so that what meets a budget does so on most days."""
    return None if item.draw_ms is None else item.draw_ms + item.draw_spread_ms


def _nearest(found: Sequence[Trained], wish: Wish) -> str:
    """How near the best came: of those within the budgets, or the best of each figure."""
    affordable = Wish(None, wish.megabytes, wish.ms)
    within = [item for item in found if affordable.is_met(item.psnr, _ms(item), item.file_mb)]
    if within and wish.psnr is not None:
        best = max(within, key=lambda item: item.psnr)
        missing = wish.psnr - best.psnr
        return f" {best.name} comes nearest, {missing:.2f} dB short ({figures(best)})."
    said = []
    if wish.megabytes is not None:
        said.append(f"{min(item.file_mb for item in found):.2f} MB at least")
    times = [ms for item in found if (ms := _ms(item)) is not None]
    if wish.ms is not None and times:
        said.append(f"{min(times):.1f} ms at least, spread included")
    return f" There is {', '.join(said)}." if said else ""
