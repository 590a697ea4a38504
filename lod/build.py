"""Build: a tree over splats, whose inner nodes have the moments of all Gaussians below them."""

from __future__ import annotations

import torch
from jaxtyping import Float, Float32
from torch import Tensor

from gsfw.core.maths.moments import Moments
from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.splats import Sh, Splats
from gsfw.lod.nodes import Nodes, TreeInMemory
from gsfw.lod.order import tree_order

MOST_OPAQUE = 0.999
"""Largest opacity of a merged Gaussian, unless one below it has more."""
REACH = 3.0
"""Standard deviations to which a Gaussian is seen."""


@torch.no_grad()
def build(splats: Splats) -> TreeInMemory:
    """Build the tree of splats.

    Args:
        splats: with quaternions, scales and SH colours; on the CPU. Means are stored as float32, so
            that they must be near the origin relative to their size.
    """
    assert isinstance(splats.colors, Sh)
    ordered = splats.take(tree_order(splats.means))
    degree = degree_of(splats.colors.dense().shape[1])
    assert ordered.scales is not None
    exact = _double(ordered)
    moments = Moments.of(exact)
    packed = [Nodes.of(ordered)]
    reach = REACH * ordered.scales.amax(1, keepdim=True)
    places = [torch.cat([ordered.means, 0 * ordered.means, reach, 0 * reach], dim=1).float()]
    while len(moments) > 1:
        moments = _parents(moments)
        packed.append(Nodes.of(moments.splats(MOST_OPAQUE)))
        places.append(_parent_places(places[-1]))
    nodes = Nodes(
        torch.cat([level.values for level in reversed(packed)]),
        torch.cat([level.rest for level in reversed(packed)]),
    )
    return TreeInMemory(len(splats), degree, torch.cat(places[::-1]), nodes)


def _double(splats: Splats) -> Splats:
    """The same with geometry in float64; colours keep their type: they are most of the memory."""
    assert splats.quats is not None
    assert splats.scales is not None
    return Splats(
        means=splats.means.double(),
        opacities=splats.opacities.double(),
        colors=splats.colors,
        quats=splats.quats.double(),
        scales=splats.scales.double(),
    )


def _parents(moments: Moments) -> Moments:
    """The moments of pairs of rows; the last one may be alone."""
    pairs = 2 * (len(moments) // 2)
    joined = Moments.joined(moments.take(slice(0, pairs, 2)), moments.take(slice(1, pairs, 2)))
    return (
        joined if pairs == len(moments) else Moments.cat([joined, moments.take(slice(pairs, None))])
    )


def _parent_places(children: Float32[Tensor, "n 8"]) -> Float32[Tensor, "p 8"]:
    """The places of the parents, which hold those of their children."""
    pairs = 2 * (len(children) // 2)
    one, other = children[:pairs:2], children[1:pairs:2]
    low = torch.minimum(one[:, :3] - one[:, 3:6], other[:, :3] - other[:, 3:6])
    high = torch.maximum(one[:, :3] + one[:, 3:6], other[:, :3] + other[:, 3:6])
    rest = torch.maximum(one[:, 6:], other[:, 6:])
    found = torch.cat([(low + high) / 2, (high - low) / 2, rest], dim=1)
    if pairs < len(children):
        found = torch.cat([found, children[pairs:]])
    found[:, 7] = torch.maximum(found[:, 7], _sizes(found))
    return found


def _sizes(places: Float32[Tensor, "p 8"]) -> Float[Tensor, " p"]:
    """Sizes of nodes: the diagonal of the box of their Gaussians' centres."""
    return 2 * places[:, 3:6].norm(dim=1)
