"""MatchGraph: which images show the same things, as their matches tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from gsfw.preparation.diagnosis.link import MOVED, FeaturePlaces, Link
from gsfw.preparation.diagnosis.repetition import repeated_share
from gsfw.preparation.image_set import ImageSet
from gsfw.preparation.native import opened_database

CHANCE = 25
"""Features that may look alike although nothing else does: of 304 pairs of a photo of fox and one
of plush, 4000 features each, one has 21 and none has more, nor any verified match."""
STILL = 0.1
"""Part of the matches of two images that stays in place while the view moves, beyond which
something does not belong to the scene: fox and plush have 0.00."""

REPEATED = 0.3
"""Part of an image's features that is repeated in it: 0.05 and less of all photos of fox and plush,
0.00 to 0.11 of a rendered facade with other marks of a fifth and more of the contrast of its
windows, 0.93 without marks. Of a wall of tiles with 0.99, 8 of 20 images were placed, wrongly."""


@dataclass(frozen=True)
class Component:
    """Images that are joined to each other, directly or through others."""

    images: tuple[str, ...]
    """In the order of the set."""
    placed: int
    """Number of these images that the model has."""

    def document(self) -> dict[str, Any]:
        """Plain data."""
        return {"images": list(self.images), "placed": self.placed}


@dataclass(frozen=True)
class Bridge:
    """The nearest pair of images of two components; panoramas stand for their views."""

    first: str
    second: str
    why: str
    """A clause that says what they have in common."""
    missing: str
    """The photos between them, as ``MatchGraph.between`` names them."""

    @property
    def advice(self) -> str:
        """The photos to take."""
        return f"take {self.missing} ({self.why})"

    def document(self) -> dict[str, Any]:
        """Plain data."""
        return {"first": self.first, "second": self.second, "why": self.why}


@dataclass(frozen=True)
class MatchGraph:
    """All images, and every pair of them that was compared and has anything in common."""

    names: tuple[str, ...]
    """Names of all images, in the order of the set."""
    links: tuple[Link, ...]
    still: float = 0.0
    """Typical part of two images' matches that stays in place although the view moves."""
    repeated: float = 0.0
    """Typical part of an image's features whose like is in it elsewhere."""
    shots: Mapping[str, str] = field(default_factory=dict)
    """The panorama of each view of one, by name: its views belong together without a match."""

    @staticmethod
    def read(database: Path, images: ImageSet) -> MatchGraph:
        """The matches of a database whose image ids are positions in the set, counted from 1.

        Raises:
            DataError: the database cannot be read.
        """
        import pycolmap

        kinds = pycolmap.TwoViewGeometryConfiguration
        flat_kinds = [int(k) for k in (kinds.PLANAR, kinds.PANORAMIC, kinds.PLANAR_OR_PANORAMIC)]
        names = tuple(image.name for image in images.images)
        shots = {image.name: image.shot for image in images.images if image.view is not None}
        if not database.exists():
            return MatchGraph(names, (), shots=shots)
        with opened_database(database, "read the matches") as opened:
            matches = dict(zip(*opened.read_num_matches(), strict=True))
            verified = dict(zip(*opened.read_two_view_geometry_num_inliers(), strict=True))
            places = FeaturePlaces(opened, images)
            links = []
            for pair in sorted(matches.keys() | verified.keys()):
                first, second = pycolmap.pair_id_to_image_pair(pair)
                ends = names[first - 1], names[second - 1]
                if verified.get(pair):
                    motion = opened.read_two_view_geometry(first, second)
                    shift = float(np.median(places.shifts(*ends, motion.inlier_matches)))
                    counts = matches.get(pair, 0), verified[pair]
                    flat = motion.config in flat_kinds
                    turn = flat and shift > MOVED and places.show_turn(*ends, motion)
                    links.append(Link(*ends, *counts, shift, flat, turn))
                elif matches.get(pair):
                    links.append(Link(*ends, matches[pair]))
            still, repeated = places.still(links), repeated_share(opened)
            return MatchGraph(names, tuple(links), still, repeated, shots)

    @property
    def has_overlay(self) -> bool:
        """True if something is in the same place in all images."""
        return self.still > STILL

    @property
    def is_repetitive(self) -> bool:
        """True if images show the same again and again, as walls of tiles do."""
        return self.repeated > REPEATED

    @cached_property
    def by_image(self) -> Mapping[str, tuple[Link, ...]]:
        """The links of each image, those with most verified matches first."""
        found: dict[str, list[Link]] = {name: [] for name in self.names}
        for link in self.links:
            found[link.first].append(link)
            found[link.second].append(link)
        return {
            name: tuple(sorted(links, key=lambda link: (-link.verified, -link.matches)))
            for name, links in found.items()
        }

    def best(self, name: str, among: Iterable[str] | None = None) -> Link | None:
        """The link of an image with most verified matches, to any or to some others."""
        others = None if among is None else frozenset(among)
        for link in self.by_image[name]:
            if others is None or link.other(name) in others:
                return link
        return None

    def components(self, placed: Iterable[str] = ()) -> tuple[Component, ...]:
        """Components of two images or more; those with most placed images come first."""
        number = self._numbers
        pairs = [(number[link.first], number[link.second]) for link in self.links if link.joins]
        first: dict[str, int] = {}
        pairs += [
            (first.setdefault(shot, number[name]), number[name])
            for name, shot in self.shots.items()
        ]
        rows, columns = np.array(pairs, int).reshape(-1, 2).T
        size = len(self.names)
        graph = sparse.coo_array((np.ones(len(rows)), (rows, columns)), (size, size))
        _, labels = sparse.csgraph.connected_components(graph, directed=False)
        members: dict[int, list[str]] = {}
        for name, label in zip(self.names, labels.tolist(), strict=True):
            members.setdefault(label, []).append(name)
        known = frozenset(placed)
        found = [
            Component(tuple(names), sum(name in known for name in names))
            for names in members.values()
            if len(names) > 1
        ]
        return tuple(sorted(found, key=lambda one: (-one.placed, -len(one.images))))

    def bridges(self, components: Sequence[Component]) -> tuple[Bridge, ...]:
        """The nearest pair of each component and those before it, the nearest first."""
        if not components:
            return ()
        waiting = {index: component.images for index, component in enumerate(components)}
        found: list[Bridge] = []
        reached = waiting.pop(0)
        nearest: dict[int, tuple[tuple[int, int, int], Bridge]] = {}
        # Prim's tree: only what was reached last can be nearer than what was before.
        while waiting:
            for index, images in waiting.items():
                link = self._nearest(reached, images)
                if index not in nearest or link[0] > nearest[index][0]:
                    nearest[index] = link
            best = max(waiting, key=lambda index: nearest[index][0])
            found.append(nearest[best][1])
            reached = waiting.pop(best)
        return tuple(found)

    def bridge(self, ours: Sequence[str], theirs: Sequence[str]) -> Bridge:
        """The nearest pair of two groups of images; none is empty."""
        return self._nearest(ours, theirs)[1]

    def _nearest(
        self, ours: Sequence[str], theirs: Sequence[str]
    ) -> tuple[tuple[int, int, int], Bridge]:
        """The closest link between two components, with its rank."""
        few, many = sorted((ours, theirs), key=len)
        known = frozenset(many)
        links = [link for name in few for link in self.by_image[name] if link.other(name) in known]
        best = max(links, key=lambda link: (link.verified, link.matches), default=None)
        gap, first, second = self._neighbors(ours, theirs)
        if best is not None and best.verified:
            why = f"{best.verified} verified matches"
            return (best.verified, best.matches, -gap), self._bridge(_ends(best, ours), why)
        if best is not None and best.matches > CHANCE:
            why = f"{best.matches} features look alike, but fit no motion of a camera"
            return (0, best.matches, -gap), self._bridge(_ends(best, ours), why)
        why = "nearest to each other by name"
        return (0, 0, -gap), self._bridge((first, second), why)

    def _bridge(self, ends: tuple[str, str], why: str) -> Bridge:
        first, second = ends
        missing = self.between(first, second)
        return Bridge(self._label(first), self._label(second), why, missing)

    def between(self, name: str, other: str) -> str:
        """Photos between an image and another, or "others"; panoramas between those of views."""
        known = [one for one in (name, other) if one in self._numbers]
        kind = "panoramas" if all(one in self.shots for one in known) else "photos"
        return f"{kind} between {self._label(name)} and {self._label(other)}"

    def _label(self, name: str) -> str:
        """The name that the user knows: a view's panorama has it."""
        return self.shots.get(name, name).removeprefix("/")

    def _neighbors(self, ours: Sequence[str], theirs: Sequence[str]) -> tuple[int, str, str]:
        """The two images that are nearest by name, and how many steps apart they are."""
        here = np.sort([self._numbers[name] for name in ours])
        there = np.array([self._numbers[name] for name in theirs])
        after = np.searchsorted(here, there)
        sides = np.stack([here[np.maximum(after - 1, 0)], here[np.minimum(after, len(here) - 1)]])
        gaps = np.abs(sides - there)
        side, place = np.unravel_index(gaps.argmin(), gaps.shape)
        ends = self.names[sides[side, place]], self.names[there[place]]
        return int(gaps[side, place]), *ends

    @cached_property
    def _numbers(self) -> Mapping[str, int]:
        return {name: index for index, name in enumerate(self.names)}


def _ends(link: Link, ours: Sequence[str]) -> tuple[str, str]:
    """The images of a link, ours first."""
    return (link.first, link.second) if link.first in ours else (link.second, link.first)
