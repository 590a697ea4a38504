"""Tile: one picture of a contact sheet, with its name and why it is shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gsfw.charts.style import INK
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Weight

SIZE = (189, 142)
"""Of the picture, in pixels."""
CAPTION = 46
"""Rows below the picture."""
SEVERE = {Weight.STOP: (176, 32, 32), Weight.LIMIT: (160, 90, 10), Weight.NOTE: (60, 60, 64)}
"""Colours of reasons."""


@dataclass(frozen=True)
class Tile:
    """A picture, or its empty frame."""

    name: str
    reason: str
    """Why it is shown; empty for an example."""
    weight: Weight
    picture: Image.Image | None
    """Of any size; ``None`` where there is none to show."""
    instead: str = ""
    """What the empty frame says."""

    def draw(self, sheet: Image.Image, corner: tuple[int, int]) -> None:
        """Draw it with its upper left corner there."""
        draw = ImageDraw.Draw(sheet)
        x, y = corner
        draw.rectangle((x, y, x + SIZE[0] - 1, y + SIZE[1] - 1), fill=(235, 235, 238))
        if self.picture is None:
            middle = (x + SIZE[0] / 2, y + SIZE[1] / 2)
            draw.text(middle, self.instead, INK, ImageFont.load_default(13), "mm")
        else:
            small = self.picture.copy()
            small.thumbnail(SIZE)
            place = (x + (SIZE[0] - small.width) // 2, y + (SIZE[1] - small.height) // 2)
            sheet.paste(small, place)
        self._caption(draw, (x, y + SIZE[1]))

    def _caption(self, draw: ImageDraw.ImageDraw, corner: tuple[int, int]) -> None:
        # Pillow does not measure text of several lines, and a name may have a line end.
        font, name = ImageFont.load_default(13), self.name.replace("\n", " ")
        while draw.textlength(name, font) > SIZE[0] and len(name) > 4:
            name = f"...{name[4:] if name.startswith('...') else name[1:]}"
        draw.text((corner[0], corner[1] + 4), name, INK, font)
        draw.text((corner[0], corner[1] + 20), self.reason, SEVERE[self.weight], font)


def tiles_of(survey: Survey, findings: Sequence[Finding], most: int, usual: int) -> list[Tile]:
    """The worst pictures of every finding in turn; some of all where no finding names any.

    Args:
        survey: knows the pictures.
        findings: what was said about them.
        most: so many at most.
        usual: so many where none stands out.
    """
    numbers = {name: view for view, name in reversed(list(enumerate(survey.viewpoints.names)))}
    queues = [
        ([name for name in f.pictures if name in numbers], f.kind, f.weight) for f in findings
    ]
    shown: dict[int, tuple[str, Weight]] = {}
    while len(shown) < most and any(names for names, _, _ in queues):
        for names, kind, weight in queues:
            if names and len(shown) < most:
                shown.setdefault(numbers[names.pop(0)], (kind, weight))
    if not shown and survey.looks.looks and most > 0:
        looks = survey.looks.looks
        chosen = np.unique(np.linspace(0, len(looks) - 1, min(len(looks), usual)).astype(int))
        shown = {looks[i].view: ("", Weight.NOTE) for i in chosen}
    return [_tile(survey, view, *why) for view, why in shown.items()]


def _tile(survey: Survey, view: int, reason: str, weight: Weight) -> Tile:
    """A sampled picture; the frame alone where it was not decoded."""
    name = survey.viewpoints.names[view]
    look = next((look for look in survey.looks.looks if look.view == view), None)
    if look is not None:
        picture = Image.fromarray((255 * look.preview.clip(0, 1)).astype(np.uint8))
        return Tile(name, reason, weight, picture)
    failed = any(number == view for number, _ in survey.looks.failures)
    return Tile(name, reason, weight, None, "does not decode" if failed else "not in the sample")
