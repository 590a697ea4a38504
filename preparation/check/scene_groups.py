"""Scene groups: images that fall into two groups without a match between them.

A capture of one place hangs together. Two groups whose cameras claim to stand side by side, and
whose images never match, show two places.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from gsfw.preparation.check.view_matches import ViewMatches
from gsfw.preparation.check.viewpoints import Viewpoints

FEWEST = 5
"""Images of a group."""
LINKS = 1.5
"""Pairs of a group, for each of its images: a chain, in which one pair may fail, has 1."""
USUAL = 0.8
"""Part of the matching pairs that are nearer to each other than what is called near."""
EXPECTED = 8.0
"""Matching pairs that there should be between the groups at least, if they showed one place: 0 of
them have a chance of e^-8."""


def separate_group(matches: ViewMatches, viewpoints: Viewpoints) -> tuple[int, ...]:
    """Views of the smaller of two groups that show different places; empty if there are none."""
    groups = _groups(matches)
    if len(groups) < 2:
        return ()
    large, small = groups[:2]
    near = _near(matches, viewpoints)
    matching = np.zeros_like(near)
    matching[tuple(matches.pairs.T)] = matching[tuple(matches.pairs[:, ::-1].T)] = True
    possible, found = 0, 0
    for group in (large, small):
        upper = np.triu_indices(len(group), 1)
        beside = near[np.ix_(group, group)][upper]
        possible += int(beside.sum())
        found += int((beside & matching[np.ix_(group, group)][upper]).sum())
    expected = int(near[np.ix_(large, small)].sum()) * found / max(possible, 1)
    return tuple(small.tolist()) if expected >= EXPECTED else ()


def _near(matches: ViewMatches, viewpoints: Viewpoints) -> Bool[np.ndarray, "v v"]:
    """True for cameras that stand and look as near to each other as most of those that match."""
    centers, axes = viewpoints.centers, viewpoints.axes
    apart = np.linalg.norm(centers[:, None] - centers, axis=2)
    turned = np.arccos(np.clip(axes @ axes.T, -1, 1))
    ends = tuple(matches.pairs.T)
    near = apart <= np.quantile(apart[ends], USUAL)
    return near & (turned <= np.quantile(turned[ends], USUAL))


def _groups(matches: ViewMatches) -> list[Int[np.ndarray, " k"]]:
    """Views of connected groups that are large and dense enough, the largest first."""
    count = int(matches.views.max(initial=-1)) + 1
    ones = np.ones(len(matches.pairs))
    links = coo_matrix((ones, tuple(matches.pairs.T)), (count, count))
    _, labels = connected_components(links, directed=False)
    found = []
    for label in np.unique(labels[matches.views]):
        group = matches.views[labels[matches.views] == label]
        pairs = int((labels[matches.pairs[:, 0]] == label).sum())
        if len(group) >= FEWEST and pairs >= LINKS * len(group):
            found.append(np.sort(group))
    return sorted(found, key=len, reverse=True)
