"""PairPlan: which images are compared, and why these."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Literal

from gsfw.core.errors import ConfigError
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.match_list import Pair
from gsfw.preparation.native import names_by_number, opened_database
from gsfw.preparation.panorama_views import DIRECTIONS
from gsfw.preparation.retrieval import look_alikes

Likeness = Mapping[str, Sequence[str]]
"""The images that look like each image, the most alike first."""
BESIDE = 3
"""Frames of panoramas up to which all views of overlapping directions are compared; beyond, views
of one direction are."""
OVERLAPPING = 60.0
"""Degrees between two directions of views that overlap, in panoramas that look the same way."""
ELSEWHERE = 10
"""Look-alikes of a frame that are not its neighbours in time, and those in other folders."""


@dataclass(frozen=True)
class PairPlan:
    """Pairs of images to match."""

    pairs: tuple[Pair, ...]
    """By name; the earlier one of the set is first, and no pair is there twice."""
    how: str
    """The sentence that says which they are, and why."""


@dataclass(frozen=True)
class MatchingRule:
    """The pairs of images that are compared."""

    matching: Literal["auto", "exhaustive", "sequential", "retrieval"] = "auto"
    """All pairs (exhaustive), neighbours in time and look-alikes (sequential), or look-alikes."""
    exhaustive_up_to: int = 200
    """Photos of which all pairs are compared, where ``matching`` is auto."""
    overlap: int = 10
    """Neighbours in time that a frame is compared with, on either side."""
    neighbors: int = 30
    """Look-alikes that an image is compared with."""
    vocabulary: Path | None = None
    """A vocabulary tree of COLMAP to find look-alikes by; ``None`` to build one of the images."""

    def check(self) -> None:
        """Check that the vocabulary exists.

        Raises:
            ConfigError: it does not.
        """
        if self.vocabulary is not None and not self.vocabulary.is_file():
            raise ConfigError(
                f"vocabulary={self.vocabulary}: there is no such file.",
                "Leave it out to build a vocabulary of the images themselves.",
            )


def plan_pairs(images: ImageSet, rule: MatchingRule, database: Path) -> PairPlan:
    """Choose the pairs to match.

    Args:
        images: all of them; those that the database does not have are left out.
        rule: the user's choice.
        database: with features.

    Raises:
        ConfigError: the vocabulary cannot be used.
        DataError: COLMAP cannot work with the database.
    """
    held = _held(database)
    chosen = tuple(image for image in images.images if image.name in held)
    if len(chosen) < 2:
        return PairPlan((), "pairs: none, as there are no two images to compare.")
    matching = rule.matching
    if matching == "auto":
        few = len(chosen) <= rule.exhaustive_up_to
        matching = "sequential" if images.in_order else "exhaustive" if few else "retrieval"
    if matching == "exhaustive":
        return _exhaustive(chosen, rule)
    likeness = look_alikes(database, rule.vocabulary)
    if matching == "sequential":
        return _sequential(chosen, rule, likeness)
    return _retrieved(chosen, rule, likeness)


def _held(database: Path) -> set[str]:
    with opened_database(database, "read the images") as opened:
        return set(names_by_number(opened).values())


def _exhaustive(chosen: Sequence[SourceImage], rule: MatchingRule) -> PairPlan:
    pairs = tuple(
        (one.name, other.name) for one, other in combinations(chosen, 2) if one.shot != other.shot
    )
    why = f", as there are at most {rule.exhaustive_up_to}" if rule.matching == "auto" else ""
    return PairPlan(pairs, f"pairs: all {len(pairs)} of {len(chosen)} images{why}.")


def _retrieved(chosen: Sequence[SourceImage], rule: MatchingRule, likeness: Likeness) -> PairPlan:
    pairs = _Pairs(chosen)
    for image in chosen:
        names = pairs.others(image.name, likeness)
        pairs.add(image.name, names, rule.neighbors)
        # The most alike may all be in the same folder, and folders would stay apart.
        elsewhere = [name for name in names if pairs.apart(image.name, name)]
        pairs.add(image.name, elsewhere, ELSEWHERE)
    why = f", as there are more than {rule.exhaustive_up_to}" if rule.matching == "auto" else ""
    apart = f", {ELSEWHERE} of them from other folders" if pairs.groups > 1 else ""
    how = f"each with the {rule.neighbors} most alike{apart}"
    return pairs.plan(f"{how}, by {_vocabulary(rule)}{why}.")


def _sequential(chosen: Sequence[SourceImage], rule: MatchingRule, likeness: Likeness) -> PairPlan:
    pairs = _Pairs(chosen)
    steps = {*range(1, rule.overlap + 1), *(2**power for power in range(rule.overlap))}
    for shots in pairs.members.values():
        for place, own in enumerate(shots):
            for step in (step for step in sorted(steps) if place + step < len(shots)):
                for image in own:
                    ahead = [
                        other.name
                        for other in shots[place + step]
                        if _may_overlap(image, other, step)
                    ]
                    pairs.add(image.name, ahead, len(ahead))
    for image in chosen:
        names = pairs.others(image.name, likeness)
        loops = [name for name in names if pairs.gap(image.name, name) > rule.overlap]
        pairs.add(image.name, loops, ELSEWHERE)
        elsewhere = [name for name in loops if pairs.apart(image.name, name)]
        pairs.add(image.name, elsewhere, ELSEWHERE)
    why = " as they follow each other in time," if rule.matching == "auto" else ""
    apart = f" and {ELSEWHERE} of other videos or folders" if pairs.groups > 1 else ""
    return pairs.plan(
        f"each with its neighbours up to {rule.overlap} before and after, and some further ones,"
        f"{why} and, to close loops, with the {ELSEWHERE} most alike elsewhere{apart}, "
        f"by {_vocabulary(rule)}."
    )


def _may_overlap(image: SourceImage, other: SourceImage, step: int) -> bool:
    """True if two images of one video, ``step`` frames apart, probably show the same."""
    if image.view is None or other.view is None or image.view.number == other.view.number:
        return True
    ahead, aside = (DIRECTIONS[one.number].from_panorama[2] for one in (image.view, other.view))
    angle = math.degrees(math.acos(max(-1.0, min(1.0, float(ahead @ aside)))))
    return step <= BESIDE and angle < OVERLAPPING + 1


def _vocabulary(rule: MatchingRule) -> str:
    if rule.vocabulary is not None:
        return f"the vocabulary {rule.vocabulary.name}"
    return "a vocabulary of their own features"


class _Pairs:
    """Pairs as they are chosen."""

    def __init__(self, chosen: Sequence[SourceImage]) -> None:
        self._order = {image.name: place for place, image in enumerate(chosen)}
        self._groups = {image.name: image.group for image in chosen}
        self._shots = {image.name: image.shot for image in chosen}
        shots: dict[str, dict[str, list[SourceImage]]] = {}
        for image in chosen:
            shots.setdefault(image.group, {}).setdefault(image.shot, []).append(image)
        self.members = {group: list(own.values()) for group, own in shots.items()}
        """Images by their groups and the moments that they were taken at."""
        self._places = {
            image.name: place
            for own in self.members.values()
            for place, shot in enumerate(own)
            for image in shot
        }
        self._pairs: set[tuple[int, int]] = set()

    @property
    def groups(self) -> int:
        """Number of folders and videos."""
        return len(self.members)

    def others(self, name: str, likeness: Likeness) -> list[str]:
        """The look-alikes of an image that were not taken with it at once."""
        shots = self._shots
        return [one for one in likeness.get(name, ()) if shots[one] != shots[name]]

    def apart(self, name: str, other: str) -> bool:
        """True if two images are of different folders or videos."""
        return self._groups[name] != self._groups[other]

    def gap(self, name: str, other: str) -> float:
        """Number of frames between two, plus one."""
        if self.apart(name, other):
            return math.inf
        return float(abs(self._places[name] - self._places[other]))

    def add(self, name: str, others: Sequence[str], count: int) -> None:
        """Pair an image with the first ``count`` of others."""
        for other in others[:count]:
            first, second = sorted((self._order[name], self._order[other]))
            self._pairs.add((first, second))

    def plan(self, how: str) -> PairPlan:
        """The plan with a description of the choice."""
        names = list(self._order)
        pairs = tuple((names[first], names[second]) for first, second in sorted(self._pairs))
        every = len(names) * (len(names) - 1) // 2
        return PairPlan(pairs, f"pairs: {len(pairs)} of {every} between {len(names)} images: {how}")
