"""Unregistered: why an image has no place in the model, the cause and not what followed from it.

A blurred image has few features, and so few matches, and so no place: it is called blurred.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from gsfw.core.words import counted
from gsfw.preparation.diagnosis.link import JOINED, LEAST, Link
from gsfw.preparation.diagnosis.match_graph import Bridge, MatchGraph
from gsfw.preparation.diagnosis.own_focals import PER_IMAGE
from gsfw.preparation.diagnosis.usual import Usual
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.image_quality import EMPTY, SOFT
from gsfw.preparation.image_set import ImageSet

DARK, BRIGHT = 0.05, 0.95
"""Mean grey levels beyond which nothing is left to see: fox has 0.46 to 0.56; at a fiftieth of the
light it has 0.01 and not one feature."""
CLIPPED = 0.5
"""Part that is pure black or white and leaves too little; the shared photos have below 0.02."""
FEW = 100
"""Features: of two neighbouring photos of fox a third match; a blur of 4 pixels leaves 541 features
and 233 matches, one of 12 pixels 65 and none."""
FEW_SHARE = 0.1
"""Part of the usual number of features."""
FEW_TO_MATCH = 3 * FEW
"""Number of features below which too few matches are likely: at most a third of them match."""
SMALL = 800
"""Pixels of a longer edge below which photos were probably shrunk: photos of phones have 4,000."""
MATCHED = 100
"""Verified matches with a placed image that acquit an image's looks: blurred by 4 pixels, a
photo of fox has 233 and is placed; smeared along 50 pixels, it has 18 and is not."""
TEXTURE = "Include something with texture: step back, or put patterned things there."
COPIED = 0.6
"""Least part of verified matches among the poorer image's features of two copies: with other
noise it is 0.9, with nothing but the same caption, a seventh of the height, 0.4."""
MANY_COPIED = 0.5
"""Part of the images that are copies of others, beyond which all of a capture shows one view."""
APART = (
    "Take each image from another place. If the object was on a turntable, hang a plain cloth "
    "behind it, or make the background transparent (PNG)."
)
MANY_TURNED = 0.5
"""Part of the links that say that the camera only turned."""


Reason = Literal[
    "does not decode",
    "too dark",
    "over-exposed",
    "empty",
    "few features",
    "motion blur",
    "blurred",
    "duplicate",
    "one view",
    "few matches",
    "matched only within its group",
    "matched, but not placed",
]
"""The reason why an image was not placed; causes before effects."""
MATCH_REASONS: frozenset[Reason] = frozenset(
    ("few matches", "matched only within its group", "matched, but not placed")
)
"""Reasons that a fault of the whole capture may cause, such as texture that repeats itself."""


@dataclass(frozen=True)
class Unregistered:
    """An image without a place, and why."""

    name: str
    path: Path
    reason: Reason
    found: str
    """A sentence with figures."""
    advice: str

    def document(self) -> dict[str, Any]:
        """Plain data."""
        return {
            "name": self.name,
            "reason": self.reason,
            "found": self.found,
            "advice": self.advice,
        }


def why_unregistered(
    images: ImageSet,
    features: Mapping[str, FeatureReport],
    graph: MatchGraph,
    models: Iterable[frozenset[str]] = (),
    assumes_one_focal: bool = False,
) -> tuple[Unregistered, ...]:
    """The images that the largest model lacks, in the order of the set.

    Args:
        images: all of them.
        features: of each.
        graph: of the same.
        models: names of the images in each model, the largest first.
        assumes_one_focal: whether images of unknown focal lengths share one.
    """
    inquiry = Inquiry(images, features, graph, tuple(models), assumes_one_focal)
    return tuple(inquiry.into(name) for name in graph.names if name not in inquiry.placed)


@dataclass(frozen=True)
class Group:
    """Images that belong together, and not to the largest model."""

    members: frozenset[str]
    what: str
    """A clause about them."""
    bridge: Bridge
    """To the largest model or another group, whichever comes nearer."""


@dataclass(frozen=True)
class Inquiry:
    """Looks for the reasons."""

    images: ImageSet
    features: Mapping[str, FeatureReport]
    graph: MatchGraph
    models: tuple[frozenset[str], ...]
    assumes_one_focal: bool

    @property
    def placed(self) -> frozenset[str]:
        """Images of the largest model."""
        return self.models[0] if self.models else frozenset()

    def into(self, name: str) -> Unregistered:
        """The first reason that holds."""
        report = self.features[name]
        if report.failure:
            advice = "Replace the file, or remove it."
            return self._because(name, "does not decode", report.failure, advice)
        looks = (self._exposure, self._plain, self._blur, self._features)
        checks: tuple[Callable[[str], Unregistered | None], ...] = (
            *(() if self._matched(name) else looks),
            self._duplicate,
            self._turned,
            self._matches,
            self._group,
        )
        reasons = (check(name) for check in checks)
        return next((reason for reason in reasons if reason), self._rest(name))

    def _because(self, name: str, reason: Reason, found: str, advice: str) -> Unregistered:
        return Unregistered(name, self.images.by_name[name].path, reason, found, advice)

    def _matched(self, name: str) -> bool:
        """True if a placed image shows so much of the same that looks are not to blame."""
        link = self.graph.best(name, self.placed)
        return link is not None and link.verified >= MATCHED

    @cached_property
    def usual(self) -> Usual:
        """Typical figures of good images of this capture."""
        return Usual.of(self.features, self.placed)

    def _exposure(self, name: str) -> Unregistered | None:
        quality = self.features[name].quality
        # An object before black or white may well be clipped around it in all images.
        clipped = quality.clipped > CLIPPED and not (
            self.placed and quality.clipped < self.usual.quality.clipped + CLIPPED / 2
        )
        if not (clipped or quality.brightness < DARK or quality.brightness > BRIGHT):
            return None
        dark = quality.brightness < 0.5
        return self._because(
            name,
            "too dark" if dark else "over-exposed",
            f"Its mean brightness is {100 * quality.brightness:.0f} % and "
            f"{100 * quality.clipped:.0f} % of it pure black or white; {self._count(name)}.",
            "Take such photos again with more light, or a longer exposure and a steady camera."
            if dark
            else "Take such photos again with a shorter exposure.",
        )

    def _plain(self, name: str) -> Unregistered | None:
        report, quality = self.features[name], self.features[name].quality
        if quality.contrast < EMPTY:
            found = f"It is of one colour; {self._count(name)}."
            advice = "Look at the file: it should show something, or else be left out."
            return self._because(name, "empty", found, advice)
        if self.usual.quality.is_plain(quality) and self._has_few(report):
            return self._because(
                name,
                "few features",
                "It shows a plain surface, with "
                f"{_percent(quality.contrast / self.usual.quality.contrast)} of the usual "
                "contrast; "
                f"{self._count(name)}.",
                TEXTURE,
            )
        return None

    def _blur(self, name: str) -> Unregistered | None:
        report, usual = self.features[name], self.usual.quality
        kind = report.blur.kind(usual)
        if kind == "sharp":
            return None
        sharpness = usual.sharpness_of(report.quality)
        found = (
            f"It has {_percent(usual.share_of_sharpness(report.quality))} of the usual sharpness"
        )
        if sharpness < SOFT and not usual.is_blurred(report.quality):
            found = f"It has hardly an edge (variance of its Laplacian {sharpness:.1g})"
        moved = kind == "motion blur"
        if moved:
            found += f", and least along {report.blur_direction or 0:.0f} degrees"
        return self._because(
            name,
            kind,
            f"{found}; {self._count(name)}.",
            "Take such photos again with a shorter exposure, more light or a slower movement."
            if moved
            else "Take such photos again in focus.",
        )

    def _features(self, name: str) -> Unregistered | None:
        if not self._has_few(self.features[name]):
            return None
        return self._because(
            name,
            "few features",
            f"{_capital(self._count(name))}; at least {math.ceil(self._needed):,} are needed.",
            self._more_features(name),
        )

    @property
    def _needed(self) -> float:
        return max(float(FEW), FEW_SHARE * self.usual.count)

    def _more_features(self, name: str) -> str:
        header = self.images.by_name[name].header
        if max(header.width, header.height) >= SMALL:
            return TEXTURE
        size = f"{header.width}x{header.height} pixels"
        return f"Give the photos at their full size, if {size} is not all of it. {TEXTURE}"

    def _has_few(self, report: FeatureReport) -> bool:
        return report.count < self._needed

    def _duplicate(self, name: str) -> Unregistered | None:
        """A copy of another, and nothing but copies shows the same."""
        links = [link for link in self.graph.by_image[name] if link.joins]
        copies = [link for link in links if is_copy(link, self.features)]
        if not copies or (len(copies) < len(links) and copies[0].other(name) not in self.placed):
            return None
        other = copies[0].other(name)
        matches = f"their {copies[0].verified} verified matches do not move."
        if self._shows_one_view:
            found = f"Most of it is in the same places as in {other}: {matches}"
            return self._because(name, "one view", found, APART)
        return self._because(
            name,
            "duplicate",
            f"It shows {other} once more: {matches}",
            "Leave it out; photos have to be taken from different places.",
        )

    @cached_property
    def _shows_one_view(self) -> bool:
        """True if nothing is placed, and most images are copies, or had one background."""
        copied = {
            name
            for link in self.graph.links
            if link.joins and is_copy(link, self.features)
            for name in (link.first, link.second)
        }
        return not self.placed and len(copied) > MANY_COPIED * len(self.graph.names)

    def _matches(self, name: str) -> Unregistered | None:
        best = self.graph.best(name)
        if best is not None and best.joins:
            return None
        partner = "it has no match with any image"
        if best is not None:
            number = str(best.verified or "no")
            partner = f"its best partner is {best.other(name)} with {number} verified matches"
        near = self.graph.bridge(self._place, (name,)).first if self.placed else "others"
        advice = f"Take {self.graph.between(name, near)}, each overlapping the next by two thirds."
        if self.features[name].count < FEW_TO_MATCH:
            advice += f" {self._more_features(name)}"
        return self._because(
            name,
            "few matches",
            f"{_capital(partner)}, where {LEAST} to {JOINED} are needed; {self._count(name)}.",
            advice,
        )

    def _group(self, name: str) -> Unregistered | None:
        for group in self._groups:
            if name in group.members:
                number = len(group.members) - 1
                others = counted(number, "other image")
                return self._because(
                    name,
                    "matched only within its group",
                    f"It and {others} {group.what}; the largest model has {len(self._place)} "
                    "images.",
                    f"{_capital(group.bridge.advice)}.",
                )
        return None

    @cached_property
    def _groups(self) -> tuple[Group, ...]:
        """Other models, and images that no match joins to the largest one."""
        if not self.placed:
            return ()
        own = [(model, "make up a model of their own") for model in self.models[1:]]
        own += [
            (frozenset(one.images), "match each other only")
            for one in self.graph.components(self.placed)
            if not one.placed
        ]
        known = self.placed.union(*(members for members, _ in own))
        groups = []
        for members, what in own:
            mine, theirs = members - self.placed, known - members
            names = [one for one in self.graph.names if one in mine]
            others = [one for one in self.graph.names if one in theirs]
            if names:
                groups.append(Group(frozenset(names), what, self.graph.bridge(others, names)))
        return tuple(groups)

    @cached_property
    def _place(self) -> tuple[str, ...]:
        """The placed images in the order of the set."""
        return tuple(name for name in self.graph.names if name in self.placed)

    def _turned(self, name: str) -> Unregistered | None:
        """Seen from where the others were taken, which tells no depth."""
        links = [link for link in self.graph.by_image[name] if link.joins]
        turned = [link for link in links if link.is_turn]
        if len(turned) <= MANY_TURNED * len(links):
            return None
        return self._because(
            name,
            "matched, but not placed",
            f"It has {turned[0].verified} verified matches with {turned[0].other(name)}, but was "
            "taken from the same place, which tells no depth.",
            "Take photos from a step aside.",
        )

    def _rest(self, name: str) -> Unregistered:
        """Matched, and yet without a place."""
        best = self.graph.best(name, self.placed) or self.graph.best(name)
        found = "It matches other images"
        if best is not None:
            found = f"It has {best.verified} verified matches with {best.other(name)}"
        advice = (
            "take more photos of the same things, from places around; avoid what moves, shines or "
            "repeats itself."
        )
        if self.graph.has_overlay:
            why = "but many matches stay in place while the view moves"
            advice = "crop or mask what is in the same place in all images."
        elif not self.placed:
            why = "but no model of more than a few points came of it"
            if self.assumes_one_focal and best is not None and best.verified >= MATCHED:
                zoomed = f"{PER_IMAGE[0].lower()}{PER_IMAGE[1:]}"
                advice = f"if the lens was zoomed or exchanged, {zoomed} If not, {advice}"
        else:
            why = "but too few of them are on points that the model has"
        return self._because(name, "matched, but not placed", f"{found}, {why}.", _capital(advice))

    def _count(self, name: str) -> str:
        count = self.features[name].count
        found = f"{count:,} feature{' was' if count == 1 else 's were'} found"
        return f"{found} where {self.usual.count:,.0f} are usual" if self.placed else found


def is_copy(link: Link, features: Mapping[str, FeatureReport]) -> bool:
    """True if two images are the same, or taken from one place in one direction."""
    count = min(features[link.first].count, features[link.second].count)
    return link.is_still and link.verified >= COPIED * count


def _capital(sentence: str) -> str:
    return sentence[:1].upper() + sentence[1:]


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"
