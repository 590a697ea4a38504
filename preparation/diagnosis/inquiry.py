"""Inquiry: why an image has no place in the model, the cause and not what followed from it.

A blurred image has few features, and so few matches, and so no place: it is called blurred.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

from gsfw.core.words import capitalized, counted, uncapitalized
from gsfw.preparation.diagnosis.image_faults import FEW_TO_MATCH, ImageFaults
from gsfw.preparation.diagnosis.link import JOINED, LEAST, Link
from gsfw.preparation.diagnosis.match_graph import Bridge, MatchGraph
from gsfw.preparation.diagnosis.own_focals import PER_IMAGE
from gsfw.preparation.diagnosis.unregistered import Unregistered
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.image_set import ImageSet

MATCHED = 100
"""Verified matches with a placed image that acquit an image's looks: blurred by 4 pixels, a
photo of fox has 233 and is placed; smeared along 50 pixels, it has 18 and is not."""
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
    found = tuple(models)
    faults = ImageFaults(images, features, found[0] if found else frozenset())
    inquiry = Inquiry(faults, graph, found, assumes_one_focal)
    return tuple(inquiry.into(name) for name in graph.names if name not in faults.placed)


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

    faults: ImageFaults
    graph: MatchGraph
    models: tuple[frozenset[str], ...]
    assumes_one_focal: bool

    @property
    def features(self) -> Mapping[str, FeatureReport]:
        """Features of each image."""
        return self.faults.features

    @property
    def placed(self) -> frozenset[str]:
        """Images of the largest model."""
        return self.faults.placed

    def into(self, name: str) -> Unregistered:
        """The first reason that holds."""
        failure = self.features[name].failure
        if failure:
            advice = "Replace the file, or remove it."
            return self.faults.because(name, "does not decode", failure, advice)
        checks: tuple[Callable[[str], Unregistered | None], ...] = (
            *(() if self._matched(name) else (self.faults.first,)),
            self._duplicate,
            self._turned,
            self._matches,
            self._group,
        )
        reasons = (check(name) for check in checks)
        return next((reason for reason in reasons if reason), self._rest(name))

    def _matched(self, name: str) -> bool:
        """True if a placed image shows so much of the same that looks are not to blame."""
        link = self.graph.best(name, self.placed)
        return link is not None and link.verified >= MATCHED

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
            return self.faults.because(name, "one view", found, APART)
        return self.faults.because(
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
            advice += f" {self.faults.more_features(name)}"
        return self.faults.because(
            name,
            "few matches",
            f"{capitalized(partner)}, where {LEAST} to {JOINED} are needed; "
            f"{self.faults.feature_count(name)}.",
            advice,
        )

    def _group(self, name: str) -> Unregistered | None:
        for group in self._groups:
            if name in group.members:
                number = len(group.members) - 1
                others = counted(number, "other image")
                return self.faults.because(
                    name,
                    "matched only within its group",
                    f"It and {others} {group.what}; the largest model has {len(self._place)} "
                    "images.",
                    f"{capitalized(group.bridge.advice)}.",
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
        return self.faults.because(
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
                zoomed = uncapitalized(PER_IMAGE)
                advice = f"if the lens was zoomed or exchanged, {zoomed} If not, {advice}"
        else:
            why = "but too few of them are on points that the model has"
        return self.faults.because(
            name, "matched, but not placed", f"{found}, {why}.", capitalized(advice)
        )


def is_copy(link: Link, features: Mapping[str, FeatureReport]) -> bool:
    """True if two images are the same, or taken from one place in one direction."""
    count = min(features[link.first].count, features[link.second].count)
    return link.is_still and link.verified >= COPIED * count
