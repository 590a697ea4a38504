"""Prune and clean: leave out Gaussians that are faint, useless, lonely or faulty."""

from __future__ import annotations

from jaxtyping import Bool
from torch import Tensor

from gsfw.core.loop.contributions import highest_rows
from gsfw.editing import cleaning, floaters
from gsfw.editing.capture import row_mask
from gsfw.editing.editable import Editable, Test
from gsfw.editing.operations.edit import Edit, Edited, Surroundings, keeping, real_capture
from gsfw.editing.operations.values import number, whole

ALL = "all"


def prune_opacity(text: str) -> Edit:
    """Keep what is opaque enough."""
    least = number(text, "an opacity in [0, 1]", 0.0, 1.0)
    return keeping(lambda piece: piece.chosen(lambda splats: splats.opacities >= least, True))


def prune_contribution(text: str) -> Edit:
    """Leave out the part that adds least to the views."""
    part = number(text, "a part of the Gaussians, from 0 to below 1", 0.0, 0.999999)

    def rows(piece: Editable) -> Bool[Tensor, " n"]:
        count = max(1, round((1 - part) * len(piece)))
        return row_mask(highest_rows(piece.shares().total, count), len(piece))

    return keeping(rows)


def prune_views(text: str) -> Edit:
    """Keep what enough views see."""
    least = whole(text, "a number of views, at least 1")

    def rows(piece: Editable) -> Bool[Tensor, " n"]:
        real_capture(piece, f"prune.views={text}")
        return piece.shares().views >= least

    return keeping(rows)


def prune_floaters(text: str) -> Edit:
    """Leave out what has few neighbours."""
    deviations = number(text, "a number of standard deviations, at least 0", 0.0)
    return keeping(
        lambda piece: piece.chosen(lambda splats: ~floaters.floating(splats.means, deviations))
    )


def clean(text: str) -> Edit:
    """Leave out what is faulty."""
    names = list(cleaning.FAULTS) if text == ALL else text.split(",")
    for name in names:
        if name not in cleaning.FAULTS:
            raise ValueError(
                f"expected all or some of {', '.join(cleaning.FAULTS)}, found {name!r}"
            )

    def edit(piece: Editable, _: Surroundings) -> Edited:
        found: list[str] = []
        for name in names:
            sound = piece.chosen(_without(cleaning.FAULTS[name]), True)
            if not bool(sound.all()):
                found.append(f"{int((~sound).sum()):,} {name}")
                piece = piece.keep(sound)
        return Edited(piece, ", ".join(found))

    return edit


def _without(fault: Test) -> Test:
    return lambda splats: ~fault(splats)
