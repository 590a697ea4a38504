"""Contact sheet: where cameras and points are, and the images to look at, on one page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from gsfw.core.files.atomic import write_atomically
from gsfw.preparation.check.image_sample import SampledImage
from gsfw.preparation.check.map_view import HELD_OUT, INK, OVERSAMPLING, PAPER, TRAINED, map_views
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.finding import Finding, Verdict, Weight

WIDTH = 1200
"""Width of the sheet, in pixels."""
MAP = (584, 440)
"""Width and height of each map, in pixels."""
MARGIN, GAP = 12, 8
"""Empty borders, and space between images, in pixels."""
TOP = 78
"""Rows of the title and the legend."""
HEADING = 40
"""Rows of the line above a row of images."""
COLUMNS, ROWS = 6, 2
"""Largest number of tiles."""
SIZE = (189, 142)
"""Width and height of the image in a tile, in pixels."""
CAPTION = 46
"""Rows below the image in a tile."""
SEVERE = {Weight.STOP: (176, 32, 32), Weight.LIMIT: (160, 90, 10), Weight.NOTE: (60, 60, 64)}
"""Colours of reasons."""
VERDICTS = {
    Verdict.GOOD: (24, 120, 60),
    Verdict.LIMITED: SEVERE[Weight.LIMIT],
    Verdict.WILL_NOT_TRAIN: SEVERE[Weight.STOP],
}
COLORS = ((225, 225, 225), (30, 136, 229), (216, 27, 96))
"""Colours of points that need degree 0, 1 and 2."""
LABELS = ("matte: degree 0", "degree 1", "degree 2 or more")
STRIP_HEIGHT, STRIP_IMAGES = 270, 6
"""Height of the images with marked points, in pixels, and their largest number."""
RADIUS = 2.5
"""Radius of a marked point, in pixels."""


def write_contact_sheet(
    path: Path, name: str, verdict: Verdict, survey: Survey | None, tiles: Sequence[Tile]
) -> None:
    """Draw the sheet as a PNG.

    Args:
        path: of the file.
        name: of the capture.
        verdict: what all findings come to.
        survey: what is known of cameras and points; ``None`` where there are no cameras.
        tiles: images to show, at most ``COLUMNS * ROWS``.

    Raises:
        OutputError: it cannot be written.
    """
    images_at = TOP if survey is None else TOP + MAP[1]
    rows = -(-len(tiles) // COLUMNS)
    strip = None if survey is None else degree_strip(survey, WIDTH)
    bottom = images_at + HEADING + rows * (SIZE[1] + CAPTION)
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
    heading = "images to look at" if worst else "some of the images; none stands out"
    font = ImageFont.load_default(15)
    draw.text((MARGIN, images_at + 24), heading if tiles else "", INK, font, "lm")
    for place, tile in enumerate(tiles):
        x = MARGIN + place % COLUMNS * (SIZE[0] + GAP)
        tile.draw(sheet, (x, images_at + HEADING + place // COLUMNS * (SIZE[1] + CAPTION)))
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
    legend = [(TRAINED, f"{int(trained.sum())} images to train on")]
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


@dataclass(frozen=True)
class Tile:
    """An image, or its empty frame."""

    name: str
    reason: str
    """The reason to show it; empty for an example."""
    weight: Weight
    image: Image.Image | None
    """An image of any size; ``None`` where there is none to show."""
    instead: str = ""
    """Text of the empty frame."""

    def draw(self, sheet: Image.Image, corner: tuple[int, int]) -> None:
        """Draw it with its upper left corner there."""
        draw = ImageDraw.Draw(sheet)
        x, y = corner
        draw.rectangle((x, y, x + SIZE[0] - 1, y + SIZE[1] - 1), fill=(235, 235, 238))
        if self.image is None:
            middle = (x + SIZE[0] / 2, y + SIZE[1] / 2)
            draw.text(middle, self.instead, INK, ImageFont.load_default(13), "mm")
        else:
            small = self.image.copy()
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
    """The worst images of every finding in turn; some of all where no finding names any.

    Args:
        survey: knows the images.
        findings: what was said about them.
        most: so many at most.
        usual: so many where none stands out.
    """
    numbers = {name: view for view, name in reversed(list(enumerate(survey.viewpoints.names)))}
    queues = [([name for name in f.images if name in numbers], f.kind, f.weight) for f in findings]
    shown: dict[int, tuple[str, Weight]] = {}
    while len(shown) < most and any(names for names, _, _ in queues):
        for names, kind, weight in queues:
            if names and len(shown) < most:
                shown.setdefault(numbers[names.pop(0)], (kind, weight))
    if not shown and survey.sample.images and most > 0:
        images = survey.sample.images
        chosen = np.unique(np.linspace(0, len(images) - 1, min(len(images), usual)).astype(int))
        shown = {images[i].view: ("", Weight.NOTE) for i in chosen}
    return [_tile(survey, view, *why) for view, why in shown.items()]


def _tile(survey: Survey, view: int, reason: str, weight: Weight) -> Tile:
    """A sampled image; the frame alone where it was not decoded."""
    name = survey.viewpoints.names[view]
    sampled = next((sampled for sampled in survey.sample.images if sampled.view == view), None)
    if sampled is not None:
        image = Image.fromarray(sampled.pixels)
        return Tile(name, reason, weight, image)
    failed = any(number == view for number, _ in survey.sample.failures)
    return Tile(name, reason, weight, None, "does not decode" if failed else "not in the sample")


def degree_strip(survey: Survey, width: int) -> Image.Image | None:
    """Images side by side, ``width`` pixels wide; ``None`` where nothing was measured."""
    found = survey.view_dependence
    if found is None:
        return None
    strip = Image.new("RGB", (width, HEADING + STRIP_HEIGHT + MARGIN), PAPER)
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
    for sampled in _spread(survey):
        image = _marked(survey, sampled)
        if left + image.width > width - MARGIN:
            break
        strip.paste(image, (left, HEADING))
        left += image.width + GAP
    return strip


def _spread(survey: Survey) -> list[SampledImage]:
    """Images that show some of the points, spread evenly."""
    shown = np.unique(survey.track_colors.views)
    images = [sampled for sampled in survey.sample.images if sampled.view in shown]
    chosen = np.unique(np.linspace(0, len(images) - 1, min(len(images), STRIP_IMAGES)).astype(int))
    return [images[number] for number in chosen]


def _marked(survey: Survey, sampled: SampledImage) -> Image.Image:
    """An image with the points it is known to show; those that ask for most are on top."""
    colors, found, viewpoints = survey.track_colors, survey.view_dependence, survey.viewpoints
    assert found is not None
    points = colors.points[colors.views == sampled.view]
    degrees = found.degrees[points]
    places = survey.scene.points.double().numpy()[colors.rows[points]]
    pixels, _ = viewpoints.project(sampled.view, places)
    width, height = viewpoints.sizes[sampled.view].tolist()
    rows = OVERSAMPLING * STRIP_HEIGHT
    size = (round(rows * width / height), rows)
    image = Image.fromarray(sampled.pixels).resize(size)
    draw, radius = ImageDraw.Draw(image), OVERSAMPLING * RADIUS
    for number in np.argsort(degrees, kind="stable"):
        x, y = (pixels[number] * rows / height).tolist()
        box = (x - radius, y - radius, x + radius, y + radius)
        draw.ellipse(box, COLORS[degrees[number]], INK)
    return image.resize((size[0] // OVERSAMPLING, STRIP_HEIGHT), Image.Resampling.BOX)
