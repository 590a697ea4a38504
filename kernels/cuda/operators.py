"""The heavy parts of a step on the GPU; what kernels do not serve goes to the torch defaults."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.autograd import forward_ad
from torch.autograd.graph import increment_version

from gsfw.core.operators import GRADIENT_LIMIT, AdamMoments, AdamSettings, Operators
from gsfw.kernels.cuda import step_jobs
from gsfw.kernels.cuda.availability import unavailable
from gsfw.kernels.cuda.cuda_launcher import cuda_launcher
from gsfw.kernels.cuda.launcher import Kernel, Launcher, address

NUMBERS = {torch.float32: "float", torch.float64: "double"}
"""C++ names of the number types of kernels."""

ALIGNMENT = 16
"""Bytes that a thread moves at once where all arrays begin at multiples of it."""


WIDTH_LIMIT = 2**31
"""Numbers that a row must be shorter than."""


class CudaOperators(Operators):
    """Operators over CUDA kernels; the host never waits, and repeating gives the same bits."""

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
        self,
        values: Tensor,
        gradient: Tensor,
        moments: AdamMoments,
        rate: float,
        settings: AdamSettings,
        finite: Bool[Tensor, ""],
        rows: Int[Tensor, " r"] | None = None,
    ) -> None:
        """One step of Adam, in place, in one pass over memory; ``rows`` are not negative."""
        numbers = [values, gradient, moments.first, moments.second]
        launcher, tables = self._launcher(numbers), _rows_of(numbers)
        beside = [(finite, torch.bool), (moments.count, torch.float64)]
        if rows is not None:
            rows = rows.contiguous()
            beside.append((rows, torch.int64))
        if launcher is None or tables is None or not _ready(beside, values.device):
            super().adam_(values, gradient, moments, rate, settings, finite, rows)
            return
        scales = values.new_empty(2)
        begin = step_jobs.BeginAdamJob(
            beta1=settings.beta1,
            beta2=settings.beta2,
            rate=rate,
            finite=address(finite),
            count=address(moments.count),
            scales=address(scales),
        )
        kind = NUMBERS[values.dtype]
        launcher.launch(Kernel("adam.cu", f"begin_adam<{kind}>"), 1, step_jobs.WARP, begin)
        job = _adam_job(tables, rows, settings, finite, scales)
        whole = rows is None and all(table.is_contiguous() for table in tables)
        kernel = Kernel("adam.cu", f"{'adam' if whole else 'adam_rows'}<{kind}>")
        blocks = _blocks(job.count * job.width, step_jobs.ADAM_THREADS * step_jobs.ADAM_NUMBERS)
        launcher.launch(kernel, blocks, step_jobs.ADAM_THREADS, job)
        for changed in (values, moments.first, moments.second, moments.count):
            increment_version(changed)

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
        for dtype in NUMBERS:
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
        kernel = Kernel("finite.cu", f"check_finite<{NUMBERS[tensors[0].dtype]}>")
        launcher.launch(kernel, blocks, step_jobs.FINITE_THREADS, job)

    def _launcher(self, tensors: Sequence[Tensor]) -> Launcher | None:
        """The launcher of kernels on these tensors; ``None`` if there is none."""
        kinds = {(tensor.dtype, tensor.device, tensor.layout) for tensor in tensors}
        ((dtype, device, layout), *more) = kinds
        if more or dtype not in NUMBERS or layout != torch.strided:
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
        blocks, kind = _tiles(rendered), NUMBERS[rendered.dtype]
        flows = None
        if ctx.needs_input_grad[0]:
            flows = rendered.new_empty(c, d, step_jobs.SSIM_FLOWS, h, w)
        sums = rendered.new_empty(step_jobs.SSIM_SUMS, blocks, dtype=torch.float64)
        job = step_jobs.SsimJob(
            images=_comparison(rendered, target, valid), flows=address(flows), sums=address(sums)
        )
        launcher.launch(Kernel("ssim.cu", f"ssim<{kind}>"), blocks, step_jobs.SSIM_THREADS, job)
        l1, dissimilarity, share = (rendered.new_empty(()) for _ in range(3))
        losses = step_jobs.LossesJob(
            sums=address(sums),
            blocks=blocks,
            channels=d,
            l1=address(l1),
            dissimilarity=address(dissimilarity),
            share=address(share),
        )
        add = Kernel("ssim.cu", f"add_losses<{kind}>")
        launcher.launch(add, 1, step_jobs.SSIM_THREADS, losses)
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
        kernel = Kernel("ssim.cu", f"ssim_backward<{NUMBERS[rendered.dtype]}>")
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


def _adam_job(
    tables: list[Tensor],
    rows: Tensor | None,
    settings: AdamSettings,
    finite: Tensor,
    scales: Tensor,
) -> step_jobs.AdamJob:
    values, gradient, first, second = (
        step_jobs.AdamRows(numbers=table.data_ptr(), stride=table.stride(0)) for table in tables
    )
    return step_jobs.AdamJob(
        values=values,
        gradient=gradient,
        first=first,
        second=second,
        rows=address(rows),
        count=len(tables[0] if rows is None else rows),
        width=tables[0].shape[1],
        weight1=1.0 - settings.beta1,
        decay2=settings.beta2,
        weight2=1.0 - settings.beta2,
        epsilon=settings.epsilon,
        gradient_limit=GRADIENT_LIMIT,
        finite=address(finite),
        scales=address(scales),
        aligned=_aligned(tables),
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


def _rows_of(tensors: Sequence[Tensor]) -> list[Tensor] | None:
    """The same memory as tables [n, m], rows at any distance; ``None`` where that cannot be."""
    if any(tensor.shape != tensors[0].shape for tensor in tensors):
        return None
    if tensors[0].numel() == 0 or tensors[0].dim() == 0 or tensors[0][0].numel() >= WIDTH_LIMIT:
        return None
    if any(not tensor[0].is_contiguous() for tensor in tensors):
        return None
    return [tensor.detach().view(len(tensor), -1) for tensor in tensors]
