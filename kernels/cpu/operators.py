"""The heavy parts of a step in native code; what it does not serve goes to the torch defaults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.autograd.graph import increment_version

from gsfw.core.maths.covariance_noise import NOISE_OPACITY, NOISE_SHARPNESS
from gsfw.core.maths.slices import Slices
from gsfw.core.operators import GRADIENT_LIMIT, AdamSettings, AdamUpdate, Gate, Layer, Operators
from gsfw.core.stereo.fusion import FusedImage, FusionRule
from gsfw.core.stereo.plane_sweep import DepthImage
from gsfw.core.stereo.plans import SweepPlan
from gsfw.core.stereo.views import StereoViews
from gsfw.kernels.cpu import field, stereo
from gsfw.kernels.cpu.native_module import native, required
from gsfw.kernels.cpu.threads import num_threads
from gsfw.kernels.tangents import has_tangents

DTYPES = (torch.float32, torch.float64)


class CpuOperators(Operators):
    """Operators over SIMD kernels; the same bits for any number of threads."""

    @classmethod
    def preference(cls, device: torch.device) -> int | None:
        """10 on the CPU where the native module is there."""
        return 10 if device.type == "cpu" and native() is not None else None

    def l1_dssim(
        self,
        rendered: Float[Tensor, "c h w d"],
        target: Float[Tensor, "c h w d"],
        valid: Bool[Tensor, "c h w 1"] | None = None,
    ) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
        """Mean absolute difference, and 1 - SSIM, over the valid pixels; both differentiable."""
        images = [rendered, target]
        masks = [] if valid is None else [valid]
        served = _served(images) and all(mask.device.type == "cpu" for mask in masks)
        if not served or target.requires_grad or has_tangents(images) or rendered.numel() == 0:
            return super().l1_dssim(rendered, target, valid)
        mask = None if valid is None else valid.contiguous().view(torch.uint8)
        return _L1Dssim.apply(rendered.contiguous(), target.contiguous(), mask)

    @torch.no_grad()
    def adam_(
        self, updates: Sequence[AdamUpdate], settings: AdamSettings, finite: Bool[Tensor, ""]
    ) -> None:
        """One step of Adam for all tensors, in place, in one pass over memory."""
        others = [update for update in updates if not _stepped(update, settings, finite)]
        super().adam_(others, settings, finite)

    def all_finite(self, tensors: Sequence[Tensor]) -> Bool[Tensor, ""]:
        """True if all numbers of all tensors are finite."""
        module, threads, others, finite = required(), num_threads(), [], True
        for tensor in tensors:
            if _served((tensor,)) and tensor.is_contiguous():
                finite = finite and module.all_finite(tensor.detach(), threads)
            else:
                others.append(tensor)
        found = torch.tensor(finite)
        return found & super().all_finite(others) if others else found

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
        """Move ``means`` by noise shaped by covariances, in one pass over memory."""
        tensors = (means, quats, log_scales, opacity_logits, noise)
        if not _served(tensors) or not all(tensor.is_contiguous() for tensor in tensors):
            super().add_noise_(means, quats, log_scales, opacity_logits, noise, rate)
            return
        required().add_noise(
            *(tensor.detach() for tensor in tensors),
            rate=rate,
            opacity=NOISE_OPACITY,
            sharpness=NOISE_SHARPNESS,
            threads=num_threads(),
        )
        increment_version(means)

    def plane_product(
        self,
        places: Float[Tensor, "n 3"],
        planes: Sequence[Float[Tensor, "3 _ _ d"]],
        lines: Sequence[Float[Tensor, "3 _ d"]],
        scale: float,
    ) -> Float[Tensor, "n f"]:
        """Products of six interpolated features; native for a multiple of 16 channels."""
        tensors = [places, *planes, *lines]
        fits = planes[0].shape[-1] % field.LANES == 0 and len(places) > 0
        if not fits or not _served(tensors) or has_tangents(tensors):
            return super().plane_product(places, planes, lines, scale)
        return field.plane_product(places, planes, lines, scale)

    def hash_features(
        self,
        places: Float[Tensor, "n 3"],
        time: Float[Tensor, ""],
        tables: Sequence[Float[Tensor, "_ d"]],
        sizes: Sequence[tuple[int, int]],
    ) -> Float[Tensor, "n f"]:
        """Interpolated rows of a hash grid's tables."""
        tensors = [places, *tables]
        fits = len(places) > 0 and max(max(size) for size in sizes) < field.MOST_CORNERS
        if not fits or not _served(tensors) or has_tangents(tensors):
            return super().hash_features(places, time, tables, sizes)
        return field.hash_features(places, float(time), tables, sizes)

    def slices(
        self,
        left: Float[Tensor, "n 4"],
        right: Float[Tensor, "n 4"],
        scales: Float[Tensor, "n 4"],
    ) -> Slices:
        """Slices of Gaussians of space and time."""
        tensors = [left, right, scales]
        if len(left) == 0 or not _served(tensors) or has_tangents(tensors):
            return super().slices(left, right, scales)
        return field.slices(left, right, scales)

    def relu_network(
        self,
        inputs: Float[Tensor, "n f"],
        layers: Sequence[Layer],
        heads: Sequence[Layer],
        gate: Gate | None = None,
    ) -> tuple[Float[Tensor, "n _"], ...]:
        """Outputs of a network; native if all layers have a multiple of 16 inputs."""
        tensors = [inputs, *(tensor for layer in (*layers, *heads) for tensor in layer)]
        tensors += [] if gate is None else [gate.least]
        fits = all(weights.shape[1] % field.LANES == 0 for weights, _ in (*layers, *heads))
        if not fits or len(inputs) == 0 or not _served(tensors) or has_tangents(tensors):
            return super().relu_network(inputs, layers, heads, gate)
        return field.relu_network(inputs, layers, heads, gate)

    def squared_differences(
        self, grid: Float[Tensor, "*cells"], axes: Sequence[int], order: int, weight: float
    ) -> Float[Tensor, ""]:
        """Mean squared differences of neighbouring cells; native for one axis, or two in turn."""
        served = grid.numel() > 0 and _served([grid]) and not has_tangents([grid])
        found = field.squared_differences(grid, axes, order, weight) if served else None
        return super().squared_differences(grid, axes, order, weight) if found is None else found

    def mean_distance(
        self, values: Float[Tensor, "*cells"], center: float, weight: float
    ) -> Float[Tensor, ""]:
        """``weight`` times the mean of |value - center|."""
        if values.numel() == 0 or not _served([values]) or has_tangents([values]):
            return super().mean_distance(values, center, weight)
        return field.mean_distance(values, center, weight)

    def sweep_views(self, views: StereoViews, plans: Sequence[SweepPlan]) -> list[DepthImage]:
        """Depths of the views of ``plans``."""
        return stereo.sweep_views(views, plans)

    def fuse_views(
        self,
        views: StereoViews,
        depths: Sequence[Float[Tensor, "_ _"]],
        neighbors: Sequence[Sequence[int]],
        rule: FusionRule,
    ) -> list[FusedImage]:
        """Points that ``neighbors`` confirm by their own ``depths``."""
        return stereo.fuse_views(views, depths, neighbors, rule)


class _L1Dssim(torch.autograd.Function):
    """Both losses; forward also computes what backward then only scales."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        rendered: Float[Tensor, "c h w d"],
        target: Float[Tensor, "c h w d"],
        valid: Tensor | None,
    ) -> tuple[Tensor, Tensor]:
        gradient = torch.empty_like(target) if ctx.needs_input_grad[0] else None
        losses = required().l1_dssim(
            rendered.detach(), target.detach(), valid, gradient, num_threads()
        )
        ctx.save_for_backward(rendered, target, valid, gradient)
        # One tensor of both would be taken apart again, at several times the cost.
        return target.new_tensor(losses[0]), target.new_tensor(losses[1])

    @staticmethod
    def backward(ctx: Any, l1: Tensor, dssim: Tensor) -> tuple[Tensor | None, None, None]:  # noqa: ANN401
        rendered, target, valid, dssim_gradient = ctx.saved_tensors
        if torch.is_grad_enabled():  # This gradient is to be differentiated again.
            mask = None if valid is None else valid.view(torch.bool)
            losses = Operators().l1_dssim(rendered, target, mask)
            (gradient,) = torch.autograd.grad(losses, rendered, (l1, dssim), create_graph=True)
            return gradient, None, None
        gradient = torch.empty_like(target)
        required().l1_dssim_backward(
            rendered.detach(),
            target.detach(),
            valid,
            dssim_gradient,
            float(l1),
            float(dssim),
            gradient,
            num_threads(),
        )
        return gradient, None, None


def _served(tensors: Sequence[Tensor]) -> bool:
    """True if native code takes numbers of this type on this device."""
    kind = tensors[0].dtype
    return kind in DTYPES and all(
        tensor.dtype == kind and tensor.is_cpu and tensor.layout == torch.strided
        for tensor in tensors
    )


def _stepped(update: AdamUpdate, settings: AdamSettings, finite: Bool[Tensor, ""]) -> bool:
    """Step one tensor in native code; false where that does not serve it."""
    values, moments, rows = update.values, update.moments, update.rows
    tensors = (values.detach(), update.gradient.detach(), moments.first, moments.second)
    if not _served(tensors) or (rows is not None and not _listed(rows)):
        return False
    if not finite:
        return True
    steps = float(moments.count) + 1.0
    done: bool = required().adam(
        *tensors,
        rows,
        beta1=settings.beta1,
        beta2=settings.beta2,
        bias2=1.0 - settings.beta2**steps,
        rate=float(update.rate) / (1.0 - settings.beta1**steps),
        epsilon=settings.epsilon,
        gradient_limit=GRADIENT_LIMIT,
        threads=num_threads(),
    )
    if done:
        moments.count += 1.0
        for changed in (values, moments.first, moments.second):
            increment_version(changed)
    return done


def _listed(rows: Tensor) -> bool:
    return rows.dtype == torch.int64 and rows.device.type == "cpu" and rows.is_contiguous()
