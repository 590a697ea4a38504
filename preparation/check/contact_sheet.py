"""Contact sheet: where cameras and points are, and the pictures to look at, on one page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from gsfw.charts.style import INK, PAPER
from gsfw.core.files.atomic import write_atomically
from gsfw.preparation.check.degree_strip import degree_strip
from gsfw.preparation.check.map_view import HELD_OUT, TRAINED, map_views
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.check.tile import CAPTION, SEVERE, SIZE, Tile
from gsfw.preparation.finding import Verdict, Weight

WIDTH = 1200
"""Of the sheet, in pixels."""
MAP = (584, 440)
MARGIN, GAP = 12, 8
TOP = 78
"""Rows of the title and the legend."""
HEADING = 40
"""Rows of the line above the pictures."""
COLUMNS, ROWS = 6, 2
"""So many pictures are shown."""
VERDICTS = {
    Verdict.GOOD: (24, 120, 60),
    Verdict.LIMITED: SEVERE[Weight.LIMIT],
    Verdict.WILL_NOT_TRAIN: SEVERE[Weight.STOP],
}


def write_contact_sheet(
    path: Path, name: str, verdict: Verdict, survey: Survey | None, tiles: Sequence[Tile]
) -> None:
    """Draw the sheet as a PNG.

    Args:
        path: of the file.
        name: of the capture.
        verdict: what all findings come to.
        survey: what is known of cameras and points; ``None`` where there are no cameras.
        tiles: pictures to show, at most ``COLUMNS * ROWS``.

    Raises:
        OutputError: it cannot be written.
    """
    pictures_at = TOP if survey is None else TOP + MAP[1]
    rows = -(-len(tiles) // COLUMNS)
    strip = None if survey is None else degree_strip(survey, WIDTH)
    bottom = pictures_at + HEADING + rows * (SIZE[1] + CAPTION)
    height = bottom + (MARGIN if strip is None else strip.height)
    sheet = Image.new("RGB", (WIDTH, height), PAPER)
    draw = ImageDraw.Draw(sheet)
    _title(draw, name.replace("\n", " "), verdict)
    if survey is None:
        small = ImageFont.load_default(14)
        draw.text((MARGIN, 55), "no camera was placed", INK, small, "lm")
    else:
        above, side, how = map_views(survey)
        _legend(draw, survey, how)
        sheet.paste(above.draw(survey, "from above", MAP), (MARGIN, TOP))
        sheet.paste(side.draw(survey, "from the side", MAP), (WIDTH - MARGIN - MAP[0], TOP))
    worst = any(tile.reason for tile in tiles)
    heading = "pictures to look at" if worst else "some of the pictures; none stands out"
    font = ImageFont.load_default(15)
    draw.text((MARGIN, pictures_at + 24), heading if tiles else "", INK, font, "lm")
    for place, tile in enumerate(tiles):
        x = MARGIN + place % COLUMNS * (SIZE[0] + GAP)
        tile.draw(sheet, (x, pictures_at + HEADING + place // COLUMNS * (SIZE[1] + CAPTION)))
    if strip is not None:
        sheet.paste(strip, (0, bottom))
    buffer = io.BytesIO()
    sheet.save(buffer, "PNG", optimize=True)
    write_atomically(path, buffer.getvalue())


def _title(draw: ImageDraw.ImageDraw, name: str, verdict: Verdict) -> None:
    font = ImageFont.load_default(24)
    draw.text((MARGIN, 22), f"{name}: ", INK, font, "lm")
    x = MARGIN + draw.textlength(f"{name}: ", font)
    draw.text((x, 22), verdict.value, VERDICTS[verdict], font, "lm")


def _legend(draw: ImageDraw.ImageDraw, survey: Survey, how: str) -> None:
    x, small = float(MARGIN), ImageFont.load_default(14)
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
