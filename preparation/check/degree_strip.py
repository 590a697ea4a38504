"""DegreeStrip: matched points over some pictures, coloured by the degree they ask for."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gsfw.charts.style import INK, PAPER
from gsfw.preparation.check.looks import Look
from gsfw.preparation.check.map_view import OVERSAMPLING
from gsfw.preparation.check.survey import Survey

COLORS = ((225, 225, 225), (30, 136, 229), (216, 27, 96))
"""Of points that ask for degree 0, 1 and 2."""
LABELS = ("matte: degree 0", "degree 1", "degree 2 or more")
HEADING, HEIGHT, MARGIN, GAP = 40, 270, 12, 8
"""Rows of the legend, rows of the pictures, and what is left free, in pixels."""
PICTURES = 6
"""So many at most."""
RADIUS = 2.5
"""Of a point."""


def degree_strip(survey: Survey, width: int) -> Image.Image | None:
    """Pictures side by side, ``width`` pixels wide; ``None`` where nothing was measured."""
    found = survey.view_dependence
    if found is None:
        return None
    strip = Image.new("RGB", (width, HEADING + HEIGHT + MARGIN), PAPER)
    draw, font = ImageDraw.Draw(strip), ImageFont.load_default(14)
    x = float(MARGIN)
    draw.text((x, HEADING / 2), "view dependence:", INK, ImageFont.load_default(15), "lm")
    x += 140
    for color, label, share in zip(COLORS, LABELS, found.shares, strict=True):
        text = f"{label} ({100 * share:.0f} %)"
        draw.ellipse((x, HEADING / 2 - 6, x + 12, HEADING / 2 + 6), color, INK)
        draw.text((x + 20, HEADING / 2), text, INK, font, "lm")
        x += 44 + draw.textlength(text, font)
    left = MARGIN
    for look in _spread(survey):
        picture = _marked(survey, look)
        if left + picture.width > width - MARGIN:
            break
        strip.paste(picture, (left, HEADING))
        left += picture.width + GAP
    return strip


def _spread(survey: Survey) -> list[Look]:
    """Pictures that show some of the points, spread evenly."""
    shown = np.unique(survey.track_colors.views)
    looks = [look for look in survey.looks.looks if look.view in shown]
    chosen = np.unique(np.linspace(0, len(looks) - 1, min(len(looks), PICTURES)).astype(int))
    return [looks[number] for number in chosen]


def _marked(survey: Survey, look: Look) -> Image.Image:
    """A picture with the points it is known to show; those that ask for most are on top."""
    colors, found, viewpoints = survey.track_colors, survey.view_dependence, survey.viewpoints
    assert found is not None
    points = colors.points[colors.views == look.view]
    degrees = found.degrees[points]
    places = survey.scene.points.double().numpy()[colors.rows[points]]
    pixels, _ = viewpoints.project(look.view, places)
    width, height = viewpoints.sizes[look.view].tolist()
    rows = OVERSAMPLING * HEIGHT
    size = (round(rows * width / height), rows)
    picture = Image.fromarray((255 * look.preview.clip(0, 1)).astype(np.uint8)).resize(size)
    draw, radius = ImageDraw.Draw(picture), OVERSAMPLING * RADIUS
    for number in np.argsort(degrees, kind="stable"):
        x, y = (pixels[number] * rows / height).tolist()
        box = (x - radius, y - radius, x + radius, y + radius)
        draw.ellipse(box, COLORS[degrees[number]], INK)
    return picture.resize((size[0] // OVERSAMPLING, HEIGHT), Image.Resampling.BOX)
