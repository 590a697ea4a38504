"""Findings on photos and matches: motion blur, one view, rotation only, a plane, static parts.

Blur, exposure and copies among placed images are told by ``gsfw check``, which looks at these.
"""

from __future__ import annotations

from collections.abc import Iterator

from gsfw.preparation.blur import ImageBlur, all_blurred, motion_findings
from gsfw.preparation.diagnosis.camera_findings import FEWEST_POINTS, has_computed_focal
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.inquiry import APART, is_copy
from gsfw.preparation.diagnosis.link import Link
from gsfw.preparation.diagnosis.repetition import ONCE
from gsfw.preparation.finding import Finding, Weight
from gsfw.preparation.image_quality import SOFT

FEWEST_VIEWS = 3
"""Different views without which there is nothing to compute."""
MOST_TURNED = 0.6
"""Part of the pairs whose view moved that only turned: 177 of 182 of a rendered turn, none of fox
and plush."""
ACROSS = 0.1
"""Shift, in longer sides, from which a pair tells a plane from a scene: half of the nearer pairs of
fox fit a plane as well as anything."""
MOST_FLAT = 0.95
"""Part of those pairs that fit a plane: 136 of 272 of fox and plush."""
FEW_PAIRS = 3
"""Pairs that tell nothing yet."""
TILTED = 10.0
"""Degrees between a view and the mean of all from which on views of a plane tell the focal length:
in 8 simulated flights over a plane (15 images, 600 points, noise of half a pixel of 1024) it was
off by at most 2 % at 10 degrees and more, by 11 % at 6, and by 26 % at 2.5."""


def view_findings(evidence: Evidence) -> Iterator[Finding]:
    """Everything that images and pairs of them show."""
    yield from _blur(evidence)
    yield from _one_view(evidence)
    yield from _turns_or_plane(evidence)
    yield from _still(evidence)


def _blur(evidence: Evidence) -> Iterator[Finding]:
    """Motion blur; and blur of all images, where no model is left for the check to judge."""
    usual = evidence.usual.quality
    if not evidence.registered and 0 < usual.sharpness < SOFT:
        yield all_blurred(usual)
    shots: dict[str, dict[str, ImageBlur]] = {}
    for name in evidence.graph.names:
        shot = evidence.graph.shots.get(name, name)
        shots.setdefault(shot, {})[name] = evidence.features[name].blur
    sharpest = []
    for views in shots.values():
        # A panorama is as sharp as its sharpest view of more than a plain wall, whose grain may
        # have a direction, or none.
        shown = {name: blur for name, blur in views.items() if not usual.is_plain(blur.quality)}
        sharpest.append(max((shown or views).items(), key=lambda view: view[1].ratio))
    yield from motion_findings(dict(sharpest), usual)


def _one_view(evidence: Evidence) -> Iterator[Finding]:
    """Copies, where hardly anything else is left."""
    if evidence.registered:
        return
    twins: set[str] = set()
    for link in evidence.graph.links:
        if link.joins and is_copy(link, evidence.features):
            # The first of several alike stays.
            twins.add(link.second)
    views = evidence.given - len(twins)
    if twins and views < FEWEST_VIEWS:
        yield Finding(
            "one view",
            Weight.STOP,
            f"{evidence.given} images show {views} different view{'s' if views > 1 else ''}: "
            "their features are in the same places.",
            "Depth needs images from different places; more images of one view add nothing.",
            f"Walk around the scene. {APART}",
            tuple(name for name in evidence.graph.names if name in twins),
        )


def _turns_or_plane(evidence: Evidence) -> Iterator[Finding]:
    links = [link for link in evidence.graph.links if link.joins]
    moved = [link for link in links if link.shift > ACROSS / 2]
    across = [link for link in links if link.shift > ACROSS]
    if len(moved) >= FEW_PAIRS and _share(moved, turned=True) > MOST_TURNED:
        yield Finding(
            "turning on the spot",
            Weight.LIMIT if _is_solid(evidence) else Weight.STOP,
            f"In {100 * _share(moved, turned=True):.0f} % of {len(moved)} pairs of images the "
            "camera has turned, and not moved.",
            "Depth needs images from different places; such images make a panorama, and no model.",
            "Walk sideways around the scene while you take photos.",
        )
    elif (
        len(across) >= FEW_PAIRS
        and _share(across, turned=False) > MOST_FLAT
        and _leaves_focal_open(evidence)
    ):
        yield Finding(
            "flat scene",
            Weight.LIMIT,
            f"In {100 * _share(across, turned=False):.0f} % of {len(across)} pairs of images all "
            "matches lie in one plane.",
            "From a plane alone, focal length and depth cannot be told apart for sure.",
            "Add images that look at it obliquely, include things in front of it, or give the "
            "focal length: gsfw prepare IMAGES out=DIR focal=PIXELS refine_focal=false.",
        )


def _is_solid(evidence: Evidence) -> bool:
    """True if there is a model of more than points by chance."""
    return evidence.figures is not None and evidence.figures.points >= FEWEST_POINTS


def _leaves_focal_open(evidence: Evidence) -> bool:
    """True if the views of a plane have not told its focal length."""
    figures = evidence.figures
    if figures is None or not _is_solid(evidence):
        return True
    return has_computed_focal(figures) and figures.baselines.view_spread < TILTED


def _share(links: list[Link], turned: bool) -> float:
    return sum(link.is_turn if turned else link.flat for link in links) / len(links)


def _still(evidence: Evidence) -> Iterator[Finding]:
    still = evidence.graph.still
    if evidence.graph.has_overlay:
        yield Finding(
            "something stands still",
            Weight.LIMIT,
            f"{100 * still:.0f} % of the matches of two images stay in place while the view "
            "moves (median).",
            "A watermark, a date, the photographer's shadow, or the room behind a turntable says "
            "that the camera has not moved.",
            "Crop or mask it; before a turntable, hang a plain cloth.",
        )


def repetition_findings(evidence: Evidence) -> Iterator[Finding]:
    """Texture that repeats itself, which others of the findings follow from."""
    if evidence.graph.is_repetitive:
        share = 100 * evidence.graph.repeated
        yield Finding(
            "repeated texture",
            Weight.LIMIT if evidence.unregistered else Weight.NOTE,
            f"{share:.0f} % of the features of an image have their like elsewhere in it "
            "(median), as those of tiles, bricks or windows.",
            "Different places that look the same are matched: images may get wrong poses, or none.",
            ONCE,
        )
