"""Contact sheet: where cameras and points are, and the pictures to look at, on one page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gsfw.commands.capture_check.map_view import HELD_OUT, TRAINED, map_views
from gsfw.commands.capture_check.survey import Survey
from gsfw.core.finding import Finding, Verdict, Weight
from gsfw.core.run_folder import write_atomically
from gsfw.core.time_plot import INK, PAPER

WIDTH = 1200
"""Of the sheet, in pixels."""
MAP = (584, 440)
MARGIN, GAP = 12, 8
TOP = 78
"""Rows of the title and the legend."""
COLUMNS, ROWS = 6, 2
"""So many pictures are shown."""
THUMB = (189, 142)
CAPTION = 46
"""Rows below each picture."""
SEVERE = {Weight.STOP: (176, 32, 32), Weight.LIMIT: (160, 90, 10), Weight.NOTE: (60, 60, 64)}
VERDICTS = {
    Verdict.GOOD: (24, 120, 60),
    Verdict.LIMITED: SEVERE[Weight.LIMIT],
    Verdict.WILL_NOT_TRAIN: SEVERE[Weight.STOP],
}


def write_contact_sheet(
    path: Path, survey: Survey, findings: Sequence[Finding], verdict: Verdict
) -> None:
    """Draw the sheet as a PNG.

    Raises:
        OutputError: it cannot be written.
    """
    shown = _shown(survey, findings)
    rows = -(-len(shown) // COLUMNS)
    height = TOP + MAP[1] + 40 + rows * (THUMB[1] + CAPTION) + MARGIN
    sheet = Image.new("RGB", (WIDTH, height), PAPER)
    draw = ImageDraw.Draw(sheet)
    above, side, how = map_views(survey)
    _title(draw, survey, verdict, how)
    sheet.paste(above.draw(survey, "from above", MAP), (MARGIN, TOP))
    sheet.paste(side.draw(survey, "from the side", MAP), (WIDTH - MARGIN - MAP[0], TOP))
    worst = any(reason for _, reason, _ in shown)
    heading = "pictures to look at" if worst else "some of the pictures; none stands out"
    font = ImageFont.load_default(15)
    draw.text((MARGIN, TOP + MAP[1] + 24), heading if shown else "", INK, font, "lm")
    for place, (view, reason, weight) in enumerate(shown):
        x = MARGIN + place % COLUMNS * (THUMB[0] + GAP)
        y = TOP + MAP[1] + 40 + place // COLUMNS * (THUMB[1] + CAPTION)
        _picture(sheet, survey, view, (x, y))
        _caption(draw, survey.viewpoints.names[view], reason, SEVERE[weight], (x, y + THUMB[1]))
    buffer = io.BytesIO()
    sheet.save(buffer, "PNG", optimize=True)
    write_atomically(path, buffer.getvalue())


def _title(draw: ImageDraw.ImageDraw, survey: Survey, verdict: Verdict, how: str) -> None:
    name = f"{survey.scene.name}: "
    font, small = ImageFont.load_default(24), ImageFont.load_default(14)
    draw.text((MARGIN, 22), name, INK, font, "lm")
    x = MARGIN + draw.textlength(name, font)
    draw.text((x, 22), verdict.value, VERDICTS[verdict], font, "lm")
    x = float(MARGIN)
    trained = survey.viewpoints.trained
    legend = [(TRAINED, f"{int(trained.sum())} pictures to train on")]
    if not trained.all():
        legend.append((HELD_OUT, f"{int((~trained).sum())} held out"))
    for color, text in legend:
        draw.rectangle((x, 48, x + 14, 62), fill=color)
        draw.text((x + 22, 55), text, INK, small, "lm")
        x += 46 + draw.textlength(text, small)
    what = f"{len(survey.scene.points):,} points"
    if not len(survey.scene.points):
        target = "the cross is where cameras look" if survey.surface else "nor a common target"
        what = f"no points; {target}"
    places = f"{len(survey.viewpoints.places)} places; " if survey.viewpoints.stand_still else ""
    draw.text((x, 55), f"{places}{what}; {how}", INK, small, "lm")


def _shown(survey: Survey, findings: Sequence[Finding]) -> list[tuple[int, str, Weight]]:
    """Views, why they are shown, and how bad that is; the worst of every finding in turn."""
    numbers = {name: view for view, name in reversed(list(enumerate(survey.viewpoints.names)))}
    queues = [(list(f.pictures), f.kind, f.weight) for f in findings if f.pictures]
    shown: dict[int, tuple[int, str, Weight]] = {}
    while len(shown) < COLUMNS * ROWS and any(names for names, _, _ in queues):
        for names, kind, weight in queues:
            if names and len(shown) < COLUMNS * ROWS:
                view = numbers[names.pop(0)]
                shown.setdefault(view, (view, kind, weight))
    if shown:
        return list(shown.values())
    looks = survey.looks.looks
    chosen = np.unique(np.linspace(0, len(looks) - 1, min(len(looks), COLUMNS)).astype(int))
    return [(looks[i].view, "", Weight.NOTE) for i in chosen] if looks else []


def _picture(sheet: Image.Image, survey: Survey, view: int, corner: tuple[int, int]) -> None:
    """A sampled picture in its frame; the frame alone where it was not decoded."""
    draw = ImageDraw.Draw(sheet)
    box = (*corner, corner[0] + THUMB[0] - 1, corner[1] + THUMB[1] - 1)
    look = next((look for look in survey.looks.looks if look.view == view), None)
    draw.rectangle(box, fill=(235, 235, 238))
    if look is None:
        failed = any(number == view for number, _ in survey.looks.failures)
        text = "does not decode" if failed else "not in the sample"
        middle = (corner[0] + THUMB[0] / 2, corner[1] + THUMB[1] / 2)
        draw.text(middle, text, INK, ImageFont.load_default(13), "mm")
        return
    picture = Image.fromarray((255 * look.preview.clip(0, 1)).astype(np.uint8))
    picture.thumbnail(THUMB)
    x = corner[0] + (THUMB[0] - picture.width) // 2
    sheet.paste(picture, (x, corner[1] + (THUMB[1] - picture.height) // 2))


def _caption(
    draw: ImageDraw.ImageDraw,
    name: str,
    reason: str,
    color: tuple[int, int, int],
    corner: tuple[int, int],
) -> None:
    font = ImageFont.load_default(13)
    while draw.textlength(name, font) > THUMB[0] and len(name) > 4:
        name = f"...{name[4:] if name.startswith('...') else name[1:]}"
    draw.text((corner[0], corner[1] + 4), name, INK, font)
    draw.text((corner[0], corner[1] + 20), reason, color, font)
