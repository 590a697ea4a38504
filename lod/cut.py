"""Cut: the nodes of a tree that are drawn for a view, within a budget.

Every Gaussian of the model has exactly one ancestor in a cut, itself included: there is no hole,
and nothing is drawn twice. A cut begins with the root, and opens the node that is the largest in
pixels, again and again, until the budget is spent or all are small enough (the granularity of Kerbl
et al. 2024, section 4.3). As no child is larger than its parent, the nodes that are opened are the
largest of all, which are found level by level. What no camera sees is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Float32, Int
from torch import Tensor

from gsfw.core.cameras import CameraModel, Cameras
from gsfw.core.errors import ConfigError
from gsfw.lod.nodes import Tree

NEAR = 1e-3
"""Least distance of a box, relative to its diagonal: the eye may be inside of it."""


@dataclass(frozen=True)
class Limits:
    """The limits of the refinement of a cut."""

    most: int
    """Most Gaussians."""
    pixels: float = 0.0
    """Size on the image below which nodes are not opened; 0: as the budget allows."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            ConfigError: one is out of range.
        """
        if self.most < 1:
            raise ConfigError(f"a budget of {self.most} Gaussians: expected at least 1.")
        if not 0 <= self.pixels < float("inf"):
            raise ConfigError(f"{self.pixels:g} pixels: expected a size of 0 or more.")


@torch.no_grad()
def select(
    tree: Tree, cameras: Cameras | Sequence[Cameras] | None, limits: Limits
) -> Int[Tensor, " m"]:
    """The numbers of the nodes to draw for some cameras, ascending.

    Args:
        tree: the tree.
        cameras: all that are to see the cut, on any device, also of several sizes; ``None`` for no
            view: nodes are then opened by their size in the scene.
        limits: the budget.
    """
    given = [cameras] if isinstance(cameras, Cameras) else cameras
    views = None if given is None else [item.to("cpu") for item in given]
    found = torch.zeros(1, dtype=torch.int64)
    sizes = _sizes(tree.places(found), views)
    opened = _Opened(limits)
    drawn, drawn_sizes = [found[sizes >= 0]], [sizes[sizes >= 0]]
    for level in range(len(tree.sizes) - 1):
        large = drawn_sizes[-1] > opened.least
        parents = drawn[-1][large] - tree.starts[level]
        children = torch.stack([2 * parents, 2 * parents + 1], dim=1).flatten()
        there = children < tree.sizes[level + 1]
        sizes = torch.full((len(children),), -1.0)
        numbers = children + tree.starts[level + 1]
        sizes[there] = _sizes(tree.places(numbers[there]), views)
        seen = sizes >= 0
        opened.add(drawn_sizes[-1][large], seen.view(-1, 2).sum(1) - 1)
        drawn.append(numbers[seen])
        drawn_sizes.append(sizes[seen])
    return _frontier(tree, drawn, drawn_sizes, opened.least)


class _Opened:
    """The nodes that may be opened, and the size above which they are."""

    def __init__(self, limits: Limits) -> None:
        """Begin with no nodes."""
        self.least = limits.pixels
        """Only larger nodes are opened; never decreases."""
        self._most = limits.most
        self._sizes, self._gains = torch.zeros(0), torch.zeros(0, dtype=torch.int64)

    def add(self, sizes: Float[Tensor, " m"], gains: Int[Tensor, " m"]) -> None:
        """Add the nodes of a level, with the number of nodes that each adds to those drawn."""
        still = self._sizes > self.least
        self._sizes = torch.cat([self._sizes[still], sizes])
        self._gains = torch.cat([self._gains[still], gains])
        if 1 + int(self._gains.sum()) <= self._most:
            return
        self._sizes, order = self._sizes.sort(descending=True)
        self._gains = self._gains[order]
        over = (1 + self._gains.cumsum(0) > self._most).nonzero()
        if len(over):
            self.least = max(self.least, float(self._sizes[over[0, 0]]))


def _frontier(
    tree: Tree,
    numbers: list[Int[Tensor, " v"]],
    sizes: list[Float[Tensor, " v"]],
    least: float,
) -> Int[Tensor, " m"]:
    """The visible nodes that are not opened, and whose parents are."""
    kept: list[Tensor] = []
    opened = torch.zeros(0, dtype=torch.int64)
    for level, (found, size) in enumerate(zip(numbers, sizes, strict=True)):
        places = found - tree.starts[level]
        is_large = size > least if level < len(tree.sizes) - 1 else torch.zeros_like(size).bool()
        has_parent = _among(places // 2, opened) if level else torch.ones_like(is_large)
        kept.append(found[~is_large & has_parent])
        opened = places[is_large & has_parent]
    return torch.cat(kept)


def _among(numbers: Int[Tensor, " m"], ascending: Int[Tensor, " v"]) -> Bool[Tensor, " m"]:
    """True for the numbers that are among others, which are ascending."""
    if not len(ascending):
        return torch.zeros_like(numbers, dtype=torch.bool)
    at = torch.searchsorted(ascending, numbers).clamp_max(len(ascending) - 1)
    return ascending[at] == numbers


def _sizes(places: Float32[Tensor, "m 8"], views: Sequence[Cameras] | None) -> Float[Tensor, " m"]:
    """Largest size of nodes on the image of any camera, in pixels; -1 for those that none sees."""
    if views is None:
        return places[:, 7]
    found = torch.full((len(places),), -1.0)
    for cameras in views:
        for index in range(len(cameras)):
            found = torch.maximum(found, _sizes_in(places, cameras.select([index])))
    return found


def _sizes_in(places: Float32[Tensor, "m 8"], camera: Cameras) -> Float[Tensor, " m"]:
    """Sizes of nodes on the image of one camera."""
    focal = float(camera.intrinsics[0, [0, 1], [0, 1]].max())
    if camera.model is CameraModel.ORTHOGRAPHIC:
        return focal * places[:, 7]
    eye = camera.centers[0].detach().float()
    beyond = ((places[:, :3] - eye).abs_() - places[:, 3:6]).clamp_min_(0)
    near = (NEAR * places[:, 7]).clamp_min(1e-12)
    sizes = focal * places[:, 7] / torch.maximum(beyond.norm(dim=1), near)
    if camera.model is not CameraModel.PINHOLE:
        return sizes
    return sizes.where(_in_view(places, camera), -1.0)


def _in_view(places: Float32[Tensor, "m 8"], camera: Cameras) -> Bool[Tensor, " m"]:
    """False for nodes that are wholly outside of one side of the view, or behind the eye."""
    pose = camera.world_to_camera[0].detach().double()
    lens = camera.intrinsics[0].detach().double()
    low = -lens[:2, 2] / lens.diag()[:2]
    high = (lens.new_tensor([camera.width, camera.height]) - lens[:2, 2]) / lens.diag()[:2]
    one, none = lens.new_tensor(1.0), lens.new_tensor(0.0)
    sides = torch.stack(
        [
            torch.stack([one, none, -low[0]]),
            torch.stack([-one, none, high[0]]),
            torch.stack([none, one, -low[1]]),
            torch.stack([none, -one, high[1]]),
            torch.stack([none, none, one]),
        ]
    )
    sides = sides / sides.norm(dim=1, keepdim=True)
    normals = (sides @ pose[:3, :3]).float()
    offsets = (sides @ pose[:3, 3]).float()
    # Of each box the corner that is furthest inside of a side.
    both = torch.cat([normals, normals.abs()], dim=1)
    inside = torch.addmm(offsets, places[:, :6], both.T).amin(1)
    return inside + places[:, 6] >= 0
