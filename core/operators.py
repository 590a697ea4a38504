"""Operators: the expensive operations of a step besides rendering, with plain torch defaults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import scipy  # Its parts are loaded when they are first used: most commands need none.
import torch
from jaxtyping import Bool, Float, Float64, Int, Int64
from torch import Tensor
from torch.nn.functional import linear, relu

from gsfw.core.maths.covariance_noise import shaped_noise
from gsfw.core.maths.hash_features import hash_features
from gsfw.core.maths.interpolation import interpolate
from gsfw.core.maths.slices import Slices, slices
from gsfw.core.maths.ssim import masked_mean, ssim
from gsfw.core.maths.variation import mean_squared_difference
from gsfw.core.progress import stage
from gsfw.core.stereo.fusion import FusedImage, FusionRule, fuse_views
from gsfw.core.stereo.plane_sweep import DepthImage, sweep_views
from gsfw.core.stereo.plans import SweepPlan
from gsfw.core.stereo.views import StereoViews

GRADIENT_LIMIT = 1e18
"""Upper bound of gradients, whose square is still finite in float32."""
PLANE_AXES = ((0, 1), (0, 2), (1, 2))
"""Axes of the planes of space: xy, xz, yz."""

Layer = tuple[Float[Tensor, "_ _"], Float[Tensor, " _"]]
"""Weights [outputs, inputs] and biases [outputs] of a fully connected layer, y = W x + b."""


@dataclass(frozen=True)
class Gate:
    """A network's head whose first output decides for each row if the other heads are needed."""

    head: int
    """Index of the head among those of the network."""
    least: Float[Tensor, " n"]
    """Other heads are 0 in rows where the output is below this; without a gradient."""

    def closed(self, values: Sequence[Float[Tensor, "n _"]]) -> Bool[Tensor, " n"]:
        """Rows that need no other head, from the heads' outputs. NaN passes."""
        return values[self.head].detach()[:, 0] < self.least

    def applied(self, values: Sequence[Float[Tensor, "n _"]]) -> tuple[Float[Tensor, "n _"], ...]:
        """Outputs with zeros where other heads are not needed."""
        return self.masked(values, self.closed(values))

    def masked(
        self, values: Sequence[Float[Tensor, "n _"]], closed: Bool[Tensor, " n"]
    ) -> tuple[Float[Tensor, "n _"], ...]:
        """Outputs, or their gradients, with zeros in the ``closed`` rows of other heads."""
        return tuple(
            value if head == self.head else value.masked_fill(closed[:, None], 0)
            for head, value in enumerate(values)
        )


@dataclass(frozen=True)
class AdamSettings:
    """Constants of Adam (Kingma and Ba 2015); epsilon as in 3DGS."""

    beta1: float = 0.9
    beta2: float = 0.999
    epsilon: float = 1e-15


@dataclass
class AdamMoments:
    """Adam's state for one tensor."""

    first: Tensor
    """Running mean of the gradient, laid out like the tensor."""
    second: Tensor
    """Running mean of the squared gradient."""
    count: Float[Tensor, ""]
    """Number of steps, for the bias correction; float64, on the tensor's device."""

    @staticmethod
    def zeros_like(values: Tensor) -> AdamMoments:
        """Fresh moments for ``values``."""
        count = torch.zeros((), dtype=torch.float64, device=values.device)
        return AdamMoments(torch.zeros_like(values), torch.zeros_like(values), count)


@dataclass(frozen=True)
class AdamUpdate:
    """The update of one tensor in a step of Adam."""

    values: Tensor
    """Changed in place."""
    gradient: Tensor
    """It has the shape of the values."""
    moments: AdamMoments
    """Its own, with a count of its own; changed in place."""
    rate: float | Float64[Tensor, ""]
    """Learning rate; a tensor where a step is recorded, and repeated at other rates."""
    rows: Int[Tensor, " r"] | None = None
    """Only these rows (of the first axis, none negative) and their moments change: the moments of
    the others do not decay, and the bias correction counts steps, not visits. ``None`` for all."""


class Operators:
    """The operations of a step besides rendering, in plain torch, which runs on any device.

    Methods and refiners get the set of the run's device, which overrides some of them.
    """

    fixed_shapes: ClassVar[bool] = False
    """True if steps should have the same shapes, and read at the same places: on a GPU, whose host
    must not wait, and which can repeat them without it. False where less work is faster, such as
    that of the visible rows alone."""

    @classmethod
    def preference(cls, device: torch.device) -> int | None:
        """Preference of this set on ``device``: the highest wins; ``None`` if it cannot run."""
        return 0

    def l1_dssim(
        self,
        rendered: Float[Tensor, "c h w d"],
        target: Float[Tensor, "c h w d"],
        valid: Bool[Tensor, "c h w 1"] | None = None,
    ) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
        """Mean absolute difference, and 1 - SSIM, over the valid pixels; both differentiable."""
        l1 = masked_mean((rendered - target).abs(), valid)
        return l1, 1.0 - ssim(rendered, target, valid)

    @torch.no_grad()
    def adam_(
        self, updates: Sequence[AdamUpdate], settings: AdamSettings, finite: Bool[Tensor, ""]
    ) -> None:
        """One step of Adam for all tensors, in place.

        When ``finite`` is false nothing changes; there is no synchronisation.
        """
        for update in updates:
            _step_of_adam(update, settings, finite)

    def all_finite(self, tensors: Sequence[Tensor]) -> Bool[Tensor, ""]:
        """True if all values of the tensors (at least one tensor) are finite."""
        return torch.stack([tensor.isfinite().all() for tensor in tensors]).all()

    @torch.no_grad()
    def add_noise_(
        self,
        means: Float[Tensor, "n 3"],
        quats: Float[Tensor, "n 4"],
        log_scales: Float[Tensor, "n 3"],
        opacity_logits: Float[Tensor, " n"],
        noise: Float[Tensor, "n 3"],
        rate: float,
    ) -> None:
        """Move ``means`` by noise shaped by covariances, in place; see ``shaped_noise``."""
        means.add_(shaped_noise(quats, log_scales, opacity_logits, noise, rate))

    def plane_product(
        self,
        places: Float[Tensor, "n 3"],
        planes: Sequence[Float[Tensor, "3 _ _ d"]],
        lines: Sequence[Float[Tensor, "3 _ d"]],
        scale: float,
    ) -> Float[Tensor, "n f"]:
        """Products of six interpolated features, for each resolution and channel; differentiable.

        Args:
            places: coordinates in [-1, 1], between the first and the last cell; constant beyond.
            planes: planes xy, xz and yz [3, r, r, d], by resolution.
            lines: time planes xt, yt and zt [3, r, d], read at one time, by resolution.
            scale: factor of all products.
        """
        axes = places.T.contiguous()
        pairs = torch.stack([torch.stack([axes[a], axes[b]]) for a, b in PLANE_AXES], dim=1)
        features = []
        for plane, line in zip(planes, lines, strict=True):
            first, second, third = interpolate(plane, pairs) * interpolate(line, axes[None])
            features.append(first * second * third)
        return torch.cat(features, dim=1) * scale

    def hash_features(
        self,
        places: Float[Tensor, "n 3"],
        time: Float[Tensor, ""],
        tables: Sequence[Float[Tensor, "_ d"]],
        sizes: Sequence[tuple[int, int]],
    ) -> Float[Tensor, "n f"]:
        """Interpolated rows of a hash grid's tables; differentiable in the tables only.

        Args:
            places: coordinates in [-1, 1]; constant beyond.
            time: time in [0, 1]; constant beyond.
            tables: rows of features, by resolution.
            sizes: corners along each axis of space, and along time, by resolution.
        """
        levels = zip(tables, sizes, strict=True)
        return torch.cat([hash_features(places, time, *level) for level in levels], dim=1)

    def slices(
        self,
        left: Float[Tensor, "n 4"],
        right: Float[Tensor, "n 4"],
        scales: Float[Tensor, "n 4"],
    ) -> Slices:
        """Slices of Gaussians of space and time; differentiable. See ``maths.slices``."""
        return slices(left, right, scales)

    def relu_network(
        self,
        inputs: Float[Tensor, "n f"],
        layers: Sequence[Layer],
        heads: Sequence[Layer],
        gate: Gate | None = None,
    ) -> tuple[Float[Tensor, "n _"], ...]:
        """Output of each head of a network; differentiable.

        Args:
            inputs: inputs of the first layer.
            layers: layers in sequence, each followed by a ReLU; at least one.
            heads: linear layers, each on its own equal part of the last layer's output.
            gate: rows that need one head only; ``None``: all need all.
        """
        for weights, biases in layers:
            inputs = relu(linear(inputs, weights, biases))
        parts = inputs.chunk(len(heads), dim=1)
        values = tuple(linear(part, *head) for part, head in zip(parts, heads, strict=True))
        return values if gate is None else gate.applied(values)

    def squared_differences(
        self, grid: Float[Tensor, "*cells"], axes: Sequence[int], order: int, weight: float
    ) -> Float[Tensor, ""]:
        """Mean squared differences of neighbouring cells, summed over ``axes``; differentiable.

        Args:
            grid: values of the cells.
            axes: axes along which neighbours are compared; those of at most ``order`` cells add 0.
            order: 1 for first differences, 2 for second ones.
            weight: factor of the result.
        """
        means = [mean_squared_difference(grid, axis, order) for axis in axes]
        return weight * torch.stack(means).sum()

    def mean_distance(
        self, values: Float[Tensor, "*cells"], center: float, weight: float
    ) -> Float[Tensor, ""]:
        """``weight`` times the mean of |value - center|; differentiable."""
        return weight * (values - center).abs().mean()

    def sweep_views(self, views: StereoViews, plans: Sequence[SweepPlan]) -> list[DepthImage]:
        """Depths of the views of ``plans``, on the CPU."""
        return sweep_views(views, plans)

    def fuse_views(
        self,
        views: StereoViews,
        depths: Sequence[Float[Tensor, "_ _"]],
        neighbors: Sequence[Sequence[int]],
        rule: FusionRule,
    ) -> list[FusedImage]:
        """Points that ``neighbors`` confirm by their own ``depths``, on the CPU."""
        return fuse_views(views, depths, neighbors, rule)

    def neighbor_distances(self, points: Float[Tensor, "p 3"], k: int) -> Float[Tensor, "p k"]:
        """Distances to the ``k`` nearest other points, nearest first; inf where there are fewer."""
        distances, _ = _nearest(points, k + 1)
        return distances[:, 1:].to(points)

    def neighbors(self, points: Float[Tensor, "p d"], k: int) -> Int[Tensor, "p k"]:
        """Rows of the ``k`` nearest other points, nearest first; its own where there are fewer."""
        _, rows = _nearest(points, k + 1)
        own = torch.arange(len(rows))[:, None]
        # A point is among its own nearest, unless more than k others have exactly its position.
        left_out = torch.where((rows == own).any(1), (rows == own).int().argmax(1), k)
        others = rows[torch.arange(k + 1) != left_out[:, None]].view(-1, k)
        return torch.where(others < len(rows), others, own).to(points.device)


def _nearest(
    points: Float[Tensor, "p d"], k: int
) -> tuple[Float64[Tensor, "p {k}"], Int64[Tensor, "p {k}"]]:
    """Distances to the ``k`` nearest points, and their rows; inf and p where there are fewer."""
    host = points.detach().double().cpu().numpy()
    with stage("finding nearest points"):
        distances, rows = scipy.spatial.cKDTree(host).query(host, k=range(1, k + 1), workers=-1)
    return torch.from_numpy(distances), torch.from_numpy(rows)


def _step_of_adam(update: AdamUpdate, settings: AdamSettings, finite: Bool[Tensor, ""]) -> None:
    values, gradient, moments = update.values, update.gradient, update.moments
    if update.rows is not None:
        rows = update.rows
        part = AdamMoments(moments.first[rows], moments.second[rows], moments.count)
        chosen = AdamUpdate(values[rows], gradient[rows], part, update.rate)
        _step_of_adam(chosen, settings, finite)
        values[rows] = chosen.values
        moments.first[rows], moments.second[rows] = part.first, part.second
        return
    gate = finite.to(values.dtype)
    moments.count += finite
    gradient = torch.where(finite, gradient, 0.0).clamp_(-GRADIENT_LIMIT, GRADIENT_LIMIT)
    # Before the first finite step the corrections are 0, and a division by them is invalid.
    bias1 = torch.where(finite, 1.0 - settings.beta1**moments.count, 1.0)
    bias2 = torch.where(finite, 1.0 - settings.beta2**moments.count, 1.0)
    moments.first.lerp_(gradient, gate * (1.0 - settings.beta1))
    moments.second.mul_(1.0 - gate * (1.0 - settings.beta2))
    moments.second.addcmul_(gradient, gradient, value=1.0 - settings.beta2)
    scale = torch.where(finite, update.rate / bias1, 0.0).to(values.dtype)
    denominator = (moments.second / bias2.to(values.dtype)).sqrt_()
    values.sub_(moments.first / denominator.add_(settings.epsilon) * scale)
