"""Nodes: the values of a tree's nodes, packed, and the interface through which a cut reads them.

Levels are numbered from the root, 0; the children of node i of a level are nodes 2 i and 2 i + 1 of
the next. The nodes of the last level are the Gaussians of the model. All nodes are numbered level
by level, so that a node and its neighbours in space are near to one another.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Bool, Float16, Float32, Int
from torch import Tensor

from gsfw.core.maths.spherical_harmonics import degree_of
from gsfw.core.splats import Sh, Splats

PLACE = 8
"""Numbers of the place of a node: the middle of the box of its Gaussians' centres, half of the
box's sides, how far those Gaussians reach beyond it, and how far apart they are."""
VALUES = 14
"""Numbers of a node's Gaussian: mean, scales, quaternion, opacity and constant coefficients."""
BYTES = 4
"""Bytes of such a number; the other coefficients have two bytes each."""


@dataclass(frozen=True)
class Nodes:
    """The Gaussians of some nodes, packed."""

    values: Float32[Tensor, "m 14"]
    """Mean, scales, quaternion (wxyz), opacity, and the constant coefficients."""
    rest: Float16[Tensor, "m c"]
    """The other coefficients, as they are in ``Sh``, row by row."""

    def __len__(self) -> int:
        return len(self.values)

    @staticmethod
    def of(splats: Splats) -> Nodes:
        """Pack splats with quaternions, scales and dense SH colours."""
        assert splats.quats is not None
        assert splats.scales is not None
        assert isinstance(splats.colors, Sh)
        colors = splats.colors.dense()
        quats = splats.quats / splats.quats.norm(dim=1, keepdim=True).clamp_min(1e-12)
        columns = [splats.means, splats.scales, quats, splats.opacities[:, None], colors[:, 0]]
        rest = colors[:, 1:].reshape(len(splats), -1).clamp(-65000, 65000)
        return Nodes(torch.cat([column.float() for column in columns], dim=1), rest.half())

    def sound(self) -> Bool[Tensor, " m"]:
        """True for nodes whose values are finite and in their ranges."""
        scales, opacities = self.values[:, 3:6], self.values[:, 10]
        finite = self.values.isfinite().all(dim=1) & self.rest.isfinite().all(dim=1)
        return finite & (scales >= 0).all(dim=1) & (opacities >= 0) & (opacities <= 1)

    def splats(self) -> Splats:
        """The splats, float32."""
        means, scales, quats, opacities, constant = self.values.split([3, 3, 4, 1, 3], dim=1)
        rest = self.rest.float().view(len(self), -1, 3)
        colors = torch.cat([constant[:, None], rest], dim=1)
        return Splats(
            means=means,
            opacities=opacities[:, 0],
            colors=Sh(colors, degree_of(colors.shape[1])),
            quats=quats,
            scales=scales,
        )


class Tree(ABC):
    """A tree of levels of detail, in memory or in a file."""

    count: int
    """Number of Gaussians of the model, the nodes of the last level."""
    sh_degree: int
    """Degree of the colours."""

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Number of nodes of each level, from the root on."""
        sizes = [self.count]
        while sizes[-1] > 1:
            sizes.append((sizes[-1] + 1) // 2)
        return tuple(reversed(sizes))

    @cached_property
    def starts(self) -> tuple[int, ...]:
        """Number of the first node of each level."""
        starts = [0]
        for size in self.sizes[:-1]:
            starts.append(starts[-1] + size)
        return tuple(starts)

    @property
    def num_nodes(self) -> int:
        """Number of nodes of all levels."""
        return sum(self.sizes)

    @property
    def node_bytes(self) -> int:
        """Bytes of the Gaussian of a node."""
        return VALUES * BYTES + 6 * ((self.sh_degree + 1) ** 2 - 1)

    @property
    def splat_bytes(self) -> int:
        """Bytes of a splat as it is rendered, float32."""
        return BYTES * (VALUES + 3 * ((self.sh_degree + 1) ** 2 - 1))

    @abstractmethod
    def places(self, numbers: Int[Tensor, " m"]) -> Float32[Tensor, "m 8"]:
        """The places of nodes; see ``PLACE``."""

    @abstractmethod
    def nodes(self, numbers: Int[Tensor, " m"]) -> Nodes:
        """The Gaussians of nodes."""


@dataclass
class TreeInMemory(Tree):
    """A tree whose nodes are all in memory."""

    count: int
    sh_degree: int
    all_places: Float32[Tensor, "N 8"]
    all_nodes: Nodes

    def places(self, numbers: Int[Tensor, " m"]) -> Float32[Tensor, "m 8"]:
        """Take them from memory."""
        return self.all_places.index_select(0, numbers)

    def nodes(self, numbers: Int[Tensor, " m"]) -> Nodes:
        """Take them from memory."""
        return Nodes(
            self.all_nodes.values.index_select(0, numbers),
            self.all_nodes.rest.index_select(0, numbers),
        )
