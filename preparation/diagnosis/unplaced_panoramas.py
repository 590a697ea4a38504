"""Unplaced panoramas: one reason for all views of a panorama, which are placed together or not."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import get_args

from gsfw.core.words import uncapitalized
from gsfw.preparation.diagnosis.image_faults import FEW_TO_MATCH, SMALL, TEXTURE
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.unregistered import Reason, Unregistered
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.image_set import ImageSet, ViewOfPanorama

ORDER: tuple[Reason, ...] = get_args(Reason)
"""Causes before effects."""


def by_panorama(
    found: Iterable[Unregistered],
    images: ImageSet,
    features: Mapping[str, FeatureReport],
    graph: MatchGraph,
    placed: tuple[str, ...],
) -> tuple[Unregistered, ...]:
    """The photos, and each panorama once: with the reason of its best view.

    A view of a plain wall is plain, or seems to be blurred along it; the panorama is not, if
    another view only lacks matches.

    Args:
        found: photos and views.
        images: all of them.
        features: of each.
        graph: of the same.
        placed: images of the largest model, in the order of the set.
    """
    shots: dict[str, list[Unregistered]] = {}
    for item in found:
        shots.setdefault(images.by_name[item.name].shot, []).append(item)
    result = []
    for items in shots.values():
        best = max(items, key=lambda one: _rank(one, features, graph))
        view = images.by_name[best.name].view
        if view is not None:
            best = _Panorama(view, items, images, features, graph, placed).with_reason_of(best)
        result.append(best)
    return tuple(result)


def _rank(
    item: Unregistered, features: Mapping[str, FeatureReport], graph: MatchGraph
) -> tuple[int, int, int]:
    """The later the reason, the better the view; of those with one reason, the more matches."""
    link = graph.best(item.name)
    verified = 0 if link is None else link.verified
    return ORDER.index(item.reason), verified, features[item.name].count


@dataclass(frozen=True)
class _Panorama:
    """A panorama that is not placed."""

    view: ViewOfPanorama
    items: list[Unregistered]
    images: ImageSet
    features: Mapping[str, FeatureReport]
    graph: MatchGraph
    placed: tuple[str, ...]

    def with_reason_of(self, best: Unregistered) -> Unregistered:
        """The item of one of its views as that of the panorama."""
        found = f"Its best view is {best.name}: {uncapitalized(best.found)}"
        advice = best.advice
        if best.reason in ("few features", "few matches"):
            advice = self._advice(best)
        return replace(best, name=self.view.panorama, found=found, advice=advice)

    def _advice(self, best: Unregistered) -> str:
        steps = []
        if best.reason == "few matches":
            near = "others"
            if self.placed:
                near = self.graph.bridge(self.placed, [item.name for item in self.items]).first
            steps.append(
                f"Take panoramas between {self.view.panorama} and {near}, a step or two apart."
            )
        if self.features[best.name].count < FEW_TO_MATCH or not steps:
            side = self.images.by_name[best.name].header.width
            if side < SMALL:
                steps.append(
                    "Give the panoramas at their full size, if they were shrunk: a view has only "
                    f"{side}x{side} pixels."
                )
            steps.append(TEXTURE)
        return " ".join(steps)
