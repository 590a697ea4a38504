"""What the photos and their matches say: motion blur, one view, turning, a plane, what stays still.

Blur, exposure and copies among placed pictures are told by ``gsfw check``, which looks at these.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

from gsfw.datamanagers.picture_quality import SOFT
from gsfw.preparation.blur import DIRECTED
from gsfw.preparation.diagnosis.camera_findings import FEWEST_POINTS
from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.link import Link
from gsfw.preparation.diagnosis.unregistered import DIRECTED_BLUR, PLAIN, is_copy
from gsfw.preparation.finding import Finding, Weight, listed

MANY = 0.1
"""Part of the pictures that matters."""
MOST_MOVED = 0.5
"""Part of the pictures from which on a directed blur is the usual one; below, it has to make a
picture less sharp than others, since single edges have a direction as well."""
ALIKE = 20.0
"""Degrees between the directions of blur of two pictures that moved along one line."""
FEWEST_VIEWS = 3
"""Different views without which there is nothing to compute."""
MOST_TURNED = 0.6
"""Part of the pairs whose view moved that only turned: all of a rendered turn, 6 of 363 of fox and
plush."""
ACROSS = 0.1
"""Shift, in longer sides, from which a pair tells a plane from a scene: half of the nearer pairs of
fox fit a plane as well as anything."""
MOST_FLAT = 0.95
"""Part of those pairs that fit a plane: 136 of 272 of fox and plush."""
FEW_PAIRS = 3
"""Pairs that tell nothing yet."""


def view_findings(evidence: Evidence) -> Iterator[Finding]:
    """Everything that pictures and pairs of them show."""
    yield from _soft(evidence)
    yield from _motion_blur(evidence)
    yield from _one_view(evidence)
    yield from _turns_or_plane(evidence)
    yield from _still(evidence)


def _soft(evidence: Evidence) -> Iterator[Finding]:
    """Where there is a model, the check tells how sharp its pictures are."""
    sharpness = evidence.usual.sharpness
    if evidence.registered or not 0 < sharpness < SOFT:
        return
    yield Finding(
        "whole capture blurred",
        Weight.LIMIT,
        "Three of four pictures have hardly an edge (variance of the Laplacian below "
        f"{sharpness:.1g}).",
        "Features of blurred pictures are few, and where they are is uncertain.",
        "Take the capture again with more light, a shorter exposure and a steady camera.",
    )


def _motion_blur(evidence: Evidence) -> Iterator[Finding]:
    moved = []
    for name in evidence.graph.names:
        report = evidence.features[name]
        # The stripes of a plain thing have a direction as well.
        plain = report.quality.contrast < PLAIN * evidence.usual.contrast
        if report.blur_direction is not None and report.blur_ratio < DIRECTED and not plain:
            moved.append(name)
    if len(moved) <= MOST_MOVED * evidence.given:
        usual = evidence.usual
        moved = [
            name
            for name in moved
            if usual.share_of_sharpness(evidence.features[name].quality) < DIRECTED_BLUR
        ]
    if not moved:
        return
    ratios = {name: evidence.features[name].blur_ratio for name in moved}
    directions = {name: evidence.features[name].blur_direction or 0.0 for name in moved}
    numbers = {name: number for number, name in enumerate(evidence.graph.names)}
    same = sum(
        numbers[after] == numbers[before] + 1
        and abs((directions[after] - directions[before] + 90) % 180 - 90) < ALIKE
        for before, after in pairwise(moved)
    )
    line = f"; {same} of them along the same line as the picture before" if same else ""
    worst = tuple(sorted(moved, key=lambda name: ratios[name]))
    yield Finding(
        "motion blur",
        Weight.LIMIT if len(moved) > MANY * evidence.given else Weight.NOTE,
        f"{len(moved)} of {evidence.given} pictures lack fine detail in one direction, down to "
        f"{100 * ratios[worst[0]]:.0f} % of that across{line}: {listed(worst)}.",
        "The camera, or what it looked at, moved while the shutter was open: edges are smeared, "
        "and features sit beside where they should.",
        "Use a shorter exposure or more light, or move more slowly; leave the worst out if others "
        "show the same.",
        worst,
    )


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
            f"{evidence.given} pictures show {views} different view{'s' if views > 1 else ''}: "
            "their features are in the same places.",
            "Depth is only seen from places apart; more pictures of one view tell nothing more.",
            "Walk around the scene, and take each picture from another place.",
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
            f"In {100 * _share(moved, turned=True):.0f} % of {len(moved)} pairs of pictures the "
            "camera has turned, and not moved.",
            "Depth is only seen from places apart; such pictures make a panorama, and no model.",
            "Walk sideways around the scene while you take pictures.",
        )
    elif len(across) >= FEW_PAIRS and _share(across, turned=False) > MOST_FLAT:
        yield Finding(
            "flat scene",
            Weight.LIMIT,
            f"In {100 * _share(across, turned=False):.0f} % of {len(across)} pairs of pictures all "
            "matches lie in one plane.",
            "From a plane alone, focal length and depth cannot be told apart for sure.",
            "Include things in front of the wall or on the ground, or give the focal length "
            "(focal=PIXELS refine_focal=false).",
        )


def _is_solid(evidence: Evidence) -> bool:
    """Whether there is a model of more than points by chance."""
    return evidence.figures is not None and evidence.figures.points >= FEWEST_POINTS


def _share(links: list[Link], turned: bool) -> float:
    return sum(link.is_turn if turned else link.flat for link in links) / len(links)


def _still(evidence: Evidence) -> Iterator[Finding]:
    still = evidence.graph.still
    if evidence.graph.has_overlay:
        yield Finding(
            "something stands still",
            Weight.LIMIT,
            f"{100 * still:.0f} % of the matches of two pictures stay in place while the view "
            "moves (median).",
            "A watermark, a date, the photographer's shadow, or the room behind a turntable says "
            "that the camera has not moved.",
            "Crop or mask it; before a turntable, hang a plain cloth.",
        )
