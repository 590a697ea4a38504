"""The heavy parts of a step on the GPU; what kernels do not serve goes to the torch defaults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from gsfw.core.maths.slices import Slices
from gsfw.core.operators import AdamSettings, AdamUpdate, Operators
from gsfw.kernels.cuda import field, penalties, step_jobs
from gsfw.kernels.cuda.adam import ALIGNMENT, adam_table, step_tables
from gsfw.kernels.cuda.availability import unavailable
from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
from gsfw.kernels.cuda.instances import NAMES, kernel_of
from gsfw.kernels.cuda.launcher import Launcher, address, blocks_for
from gsfw.kernels.cuda.neighbors import can_find, neighbors
from gsfw.kernels.cuda.step_jobs import AdamTable
from gsfw.kernels.tangents import has_tangents


class CudaOperators(Operators):
    """Operators over CUDA kernels; the host never waits.

    Repeating gives the same bits, but for the gradients of planes and of hash grids: atomics add
    them in no fixed order. Where torch is told to use deterministic algorithms, it gets these.
    """

    fixed_shapes: ClassVar[bool] = True

    def __init__(self, launcher: Launcher | None = None) -> None:
        """Without ``launcher`` kernels run on the device that the tensors are on."""
        self._given = launcher

    @classmethod
    def preference(cls, device: torch.device) -> int | None:
        """10 on a GPU where kernels can be compiled and run."""
        return 10 if device.type == "cuda" and not unavailable() else None

    def l1_dssim(
        self,
        rendered: Float[Tensor, "c h w d"],
        target: Float[Tensor, "c h w d"],
        valid: Bool[Tensor, "c h w 1"] | None = None,
    ) -> tuple[Float[Tensor, ""], Float[Tensor, ""]]:
        """Mean absolute difference, and 1 - SSIM, over the valid pixels; both differentiable."""
        launcher = self._differentiating([rendered, target])
        fitting = rendered.shape == target.shape and _covers(valid, rendered)
        if launcher is None or not fitting or target.requires_grad or rendered.numel() == 0:
            return super().l1_dssim(rendered, target, valid)
        mask = None if valid is None else valid.contiguous().view(torch.uint8)
        return _L1Dssim.apply(rendered.contiguous(), target.contiguous(), mask, launcher)

    @torch.no_grad()
    def adam_(
        self, updates: Sequence[AdamUpdate], settings: AdamSettings, finite: Bool[Tensor, ""]
    ) -> None:
        """One step of Adam for all tensors, in place, in one pass over memory."""
        served: dict[torch.dtype, list[tuple[AdamUpdate, AdamTable]]] = {}
        others: list[AdamUpdate] = []
        for update in updates:
            moments = update.moments
            numbers = (update.values, update.gradient, moments.first, moments.second)
            kernels = self._launcher(numbers) is not None
            table = adam_table(update, finite) if kernels else None
            if table is None:
                others.append(update)
            else:
                served.setdefault(update.values.dtype, []).append((update, table))
        for pairs in served.values():
            launcher = self._launcher([pairs[0][0].values])
            assert launcher is not None, "updates were chosen by it"
            for start in range(0, len(pairs), step_jobs.ADAM_TABLES):
                chosen, tables = zip(*pairs[start : start + step_jobs.ADAM_TABLES], strict=True)
                step_tables(launcher, chosen, tables, settings, finite)
        super().adam_(others, settings, finite)

    def all_finite(self, tensors: Sequence[Tensor]) -> Bool[Tensor, ""]:
        """True if all numbers of all tensors are finite."""
        served: list[Tensor] = []
        others: list[Tensor] = []
        for tensor in tensors:
            kernels = tensor.device == tensors[0].device and self._launcher([tensor]) is not None
            (served if kernels and tensor.is_contiguous() else others).append(tensor)
        if not served:
            return super().all_finite(tensors)
        finite = torch.ones((), dtype=torch.bool, device=tensors[0].device)
        for dtype in NAMES:
            kept = [tensor for tensor in served if tensor.dtype == dtype and tensor.numel()]
            for start in range(0, len(kept), step_jobs.FINITE_TENSORS):
                self._check_finite(kept[start : start + step_jobs.FINITE_TENSORS], finite)
        return finite & super().all_finite(others) if others else finite

    def _check_finite(self, tensors: list[Tensor], finite: Tensor) -> None:
        """Lower the flag where a number of these tensors, of one type, is infinite or NaN."""
        launcher = self._launcher(tensors)
        assert launcher is not None, "tensors were chosen by it"
        job = step_jobs.FiniteJob(finite=address(finite), aligned=_aligned(tensors))
        blocks = 0
        for index, tensor in enumerate(tensors):
            job.numbers[index] = address(tensor)
            job.counts[index] = tensor.numel()
            job.first_blocks[index] = blocks
            blocks += blocks_for(tensor.numel(), step_jobs.FINITE_NUMBERS)
        for index in range(len(tensors), step_jobs.FINITE_TENSORS):
            job.first_blocks[index] = blocks
        kernel = kernel_of("finite.cu", "check_finite", tensors[0].dtype)
        launcher.launch(kernel, blocks, step_jobs.FINITE_THREADS, job)

    def plane_product(
        self,
        places: Float[Tensor, "n 3"],
        planes: Sequence[Float[Tensor, "3 _ _ d"]],
        lines: Sequence[Float[Tensor, "3 _ d"]],
        scale: float,
    ) -> Float[Tensor, "n f"]:
        """Products of six interpolated features, of all resolutions in one launch."""
        launcher = self._differentiating([places, *planes, *lines])
        if launcher is None or field.ordered() or not field.fits_planes(places, planes, lines):
            return super().plane_product(places, planes, lines, scale)
        return field.plane_product(launcher, places, planes, lines, scale)

    def hash_features(
        self,
        places: Float[Tensor, "n 3"],
        time: Float[Tensor, ""],
        tables: Sequence[Float[Tensor, "_ d"]],
        sizes: Sequence[tuple[int, int]],
    ) -> Float[Tensor, "n f"]:
        """Interpolated rows of a hash grid's tables, of all resolutions in one launch."""
        launcher = self._differentiating([places, *tables])
        fits = launcher and field.fits_tables(places, time, tables, sizes)
        if launcher is None or field.ordered() or not fits:
            return super().hash_features(places, time, tables, sizes)
        return field.hash_features(launcher, places, time, tables, sizes)

    def slices(
        self,
        left: Float[Tensor, "n 4"],
        right: Float[Tensor, "n 4"],
        scales: Float[Tensor, "n 4"],
    ) -> Slices:
        """Slices of Gaussians of space and time, in one launch."""
        launcher = self._differentiating([left, right, scales])
        fits = left.shape == right.shape == scales.shape == (len(left), 4)
        if launcher is None or not fits or not len(left):
            return super().slices(left, right, scales)
        return field.slices(launcher, left, right, scales)

    def squared_differences(
        self, grid: Float[Tensor, "*cells"], axes: Sequence[int], order: int, weight: float
    ) -> Float[Tensor, ""]:
        """Mean squared differences of neighbouring cells, of one axis, or two in turn."""
        launcher = self._penalising(grid)
        found = (
            penalties.squared_differences(launcher, grid, axes, order, weight) if launcher else None
        )
        return super().squared_differences(grid, axes, order, weight) if found is None else found

    def mean_distance(
        self, values: Float[Tensor, "*cells"], center: float, weight: float
    ) -> Float[Tensor, ""]:
        """``weight`` times the mean of |value - center|."""
        launcher = self._penalising(values)
        if launcher is None:
            return super().mean_distance(values, center, weight)
        return penalties.mean_distance(launcher, values, center, weight)

    def _penalising(self, grid: Tensor) -> Launcher | None:
        """The launcher of regularisers of a grid; ``None`` if they do not serve it."""
        fits = 0 < grid.numel() < penalties.COUNT_LIMIT
        return self._differentiating([grid]) if fits else None

    def neighbors(self, points: Float[Tensor, "p d"], k: int) -> Int[Tensor, "p k"]:
        """Rows of the ``k`` nearest other points, nearest first; its own where there are fewer.

        Distances are rounded to the type of the points.
        """
        launcher = self._launcher([points])
        if launcher is None or not can_find(points, k):
            return super().neighbors(points, k)
        return neighbors(points, k, launcher)

    def _differentiating(self, tensors: Sequence[Tensor]) -> Launcher | None:
        """The launcher of kernels with a backward pass; ``None`` if they do not serve these."""
        return None if has_tangents(tensors) else self._launcher(tensors)

    def _launcher(self, tensors: Sequence[Tensor]) -> Launcher | None:
        """The launcher of kernels on these tensors; ``None`` if there is none."""
        kinds = {(tensor.dtype, tensor.device, tensor.layout) for tensor in tensors}
        ((dtype, device, layout), *more) = kinds
        if more or dtype not in NAMES or layout != torch.strided:
            return None
        if self._given is not None:
            return self._given
        return cuda_launcher(device) if device.type == "cuda" else None


class _L1Dssim(torch.autograd.Function):
    """Both losses; forward keeps what flows back through SSIM until backward knows how much."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        rendered: Float[Tensor, "c h w d"],
        target: Float[Tensor, "c h w d"],
        valid: Tensor | None,
        launcher: Launcher,
    ) -> tuple[Tensor, Tensor]:
        c, h, w, d = rendered.shape
        blocks = _tiles(rendered)
        flows = None
        if ctx.needs_input_grad[0]:
            flows = rendered.new_empty(c, d, step_jobs.SSIM_FLOWS, h, w)
        sums = rendered.new_empty(step_jobs.SSIM_SUMS, blocks, dtype=torch.float64)
        job = step_jobs.SsimJob(
            images=_comparison(rendered, target, valid), flows=address(flows), sums=address(sums)
        )
        launcher.launch(
            kernel_of("ssim.cu", "ssim", rendered.dtype), blocks, step_jobs.SSIM_THREADS, job
        )
        l1, dissimilarity, share = (rendered.new_empty(()) for _ in range(3))
        losses = step_jobs.LossesJob(
            sums=address(sums),
            blocks=blocks,
            channels=d,
            l1=address(l1),
            dissimilarity=address(dissimilarity),
            share=address(share),
        )
        launcher.launch(
            kernel_of("ssim.cu", "add_losses", rendered.dtype), 1, step_jobs.SSIM_THREADS, losses
        )
        ctx.save_for_backward(rendered, target, valid, flows, share)
        ctx.launcher = launcher
        return l1, dissimilarity

    @staticmethod
    def backward(
        ctx: Any,  # noqa: ANN401
        l1: Tensor,
        dissimilarity: Tensor,
    ) -> tuple[Tensor | None, None, None, None]:
        rendered, target, valid, flows, share = ctx.saved_tensors
        if torch.is_grad_enabled():  # This gradient is to be differentiated again.
            mask = None if valid is None else valid.view(torch.bool)
            losses = Operators().l1_dssim(rendered, target, mask)
            arriving = (l1, dissimilarity)
            (gradient,) = torch.autograd.grad(losses, rendered, arriving, create_graph=True)
            return gradient, None, None, None
        gradient = torch.empty_like(rendered)
        job = step_jobs.SsimBackwardJob(
            images=_comparison(rendered, target, valid),
            flows=address(flows),
            share=address(share),
            l1_gradient=address(l1),
            dissimilarity_gradient=address(dissimilarity),
            gradient=address(gradient),
        )
        kernel = kernel_of("ssim.cu", "ssim_backward", rendered.dtype)
        ctx.launcher.launch(kernel, _tiles(rendered), step_jobs.SSIM_THREADS, job)
        return gradient, None, None, None


def _comparison(rendered: Tensor, target: Tensor, valid: Tensor | None) -> step_jobs.Comparison:
    c, h, w, d = rendered.shape
    return step_jobs.Comparison(
        rendered=address(rendered),
        target=address(target),
        valid=address(valid),
        images=c,
        height=h,
        width=w,
        channels=d,
    )


def _tiles(images: Tensor) -> int:
    """Blocks that together answer for images [c, h, w, d]."""
    c, h, w, _ = images.shape
    return c * blocks_for(h, step_jobs.SSIM_HEIGHT) * blocks_for(w, step_jobs.SSIM_WIDTH)


def _aligned(tensors: Sequence[Tensor]) -> bool:
    return all(tensor.data_ptr() % ALIGNMENT == 0 for tensor in tensors)


def _covers(valid: Tensor | None, images: Tensor) -> bool:
    """True if a mask has a value for every pixel in memory that kernels can read."""
    if valid is None:
        return True
    return valid.shape == (*images.shape[:3], 1) and _ready([(valid, torch.bool)], images.device)


def _ready(tensors: Sequence[tuple[Tensor, torch.dtype]], device: torch.device) -> bool:
    """True if each tensor is on the device and of its type."""
    return all(tensor.device == device and tensor.dtype == dtype for tensor, dtype in tensors)
