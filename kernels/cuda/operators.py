"""The heavy parts of a step on the GPU; what kernels do not serve goes to the torch defaults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.autograd import forward_ad

from gsfw.core.operators import AdamSettings, AdamUpdate, Operators
from gsfw.kernels.cuda import step_jobs
from gsfw.kernels.cuda.adam import ALIGNMENT, adam_table, step_tables
from gsfw.kernels.cuda.availability import unavailable
from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
from gsfw.kernels.cuda.instances import NAMES, kernel_of
from gsfw.kernels.cuda.launcher import Launcher, address
from gsfw.kernels.cuda.step_jobs import AdamTable


class CudaOperators(Operators):
    """Operators over CUDA kernels; the host never waits, and repeating gives the same bits."""

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
        launcher = self._launcher([rendered, target])
        fitting = rendered.shape == target.shape and _covers(valid, rendered)
        plain = target.requires_grad or _tangents([rendered, target]) or rendered.numel() == 0
        if launcher is None or not fitting or plain:
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
            blocks += _blocks(tensor.numel(), step_jobs.FINITE_NUMBERS)
        for index in range(len(tensors), step_jobs.FINITE_TENSORS):
            job.first_blocks[index] = blocks
        kernel = kernel_of("finite.cu", "check_finite", tensors[0].dtype)
        launcher.launch(kernel, blocks, step_jobs.FINITE_THREADS, job)

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


def _blocks(numbers: int, per_block: int) -> int:
    """Blocks that together answer for so many numbers."""
    return -(-numbers // per_block)


def _tiles(images: Tensor) -> int:
    """Blocks that together answer for images [c, h, w, d]."""
    c, h, w, _ = images.shape
    return c * _blocks(h, step_jobs.SSIM_HEIGHT) * _blocks(w, step_jobs.SSIM_WIDTH)


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


def _tangents(tensors: Sequence[Tensor]) -> bool:
    """True if forward-mode derivatives are in use, which only plain torch supports."""
    return any(forward_ad.unpack_dual(tensor).tangent is not None for tensor in tensors)
