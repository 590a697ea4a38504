"""GsplatStep: a training step as gsplat's own trainer does it, to compare whole steps fairly.

By default gsplat's examples/simple_trainer.py (Apache-2.0; read, not copied) has SH degree 3 in two
tensors, ``packed=False``, 0.8 L1 + 0.2 (1 - SSIM) with the fused-ssim package, and one fused Adam
per tensor; its ``visible_adam`` takes gsplat's SelectiveAdam instead. Where fused-ssim is not
installed, our fused operators stand in for it, so that the difference lies elsewhere.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import l1_loss

from gsfw.core.operators import Operators
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.rasterizers.gsplat import package
from gsfw.studies.bench.step import RATE, SH_DEGREE, SSIM_WEIGHT, random_target, with_harmonics
from gsfw.studies.bench.workload import Workload

EPSILON, BETAS = 1e-15, (0.9, 0.999)

FUSED_SSIM = "fused_ssim"
"""The package that gsplat's trainer needs besides."""


def gsplat_steps(workload: Workload, operators: Operators, sparse: bool) -> dict[str, GsplatStep]:
    """The steps to measure beside those with our loss and optimizer, by the name of the figure."""
    gsplat = package.load()
    steps = {"own_step": GsplatStep(gsplat, workload, operators)}
    selective = getattr(import_module("gsplat.optimizers"), "SelectiveAdam", None)
    if sparse and selective is not None:
        steps["own_sparse_step"] = GsplatStep(gsplat, workload, operators, selective)
    return steps


def ssim_source() -> str:
    """Whose SSIM these steps use."""
    return "fused-ssim" if find_spec(FUSED_SSIM) else "ours"


class GsplatStep:
    """Parameters -> gsplat.rasterization -> loss -> backward -> optimizers."""

    def __init__(
        self,
        gsplat: Any,  # noqa: ANN401 - a module without types
        workload: Workload,
        operators: Operators,
        selective: Any = None,  # noqa: ANN401 - a class without types
    ) -> None:
        """Steps on a workload.

        Args:
            gsplat: the package.
            workload: what is drawn, and where.
            operators: for the loss, without fused-ssim.
            selective: an optimizer that moves only what is seen; plain Adam if ``None``.
        """
        self._gsplat, self._cameras, self._operators = gsplat, workload.cameras, operators
        start = from_splats(with_harmonics(workload.to(torch.device("cpu")).splats), SH_DEGREE)
        tensors = {
            "means": start.means,
            "scales": start.log_scales,
            "quats": start.quats,
            "opacities": start.opacity_logits,
            "sh0": start.sh[:, :1],
            "shN": start.sh[:, 1:],
        }
        device = workload.splats.means.device
        self._parameters = {
            name: tensor.to(device, copy=True).contiguous().requires_grad_()
            for name, tensor in tensors.items()
        }
        self._selective = selective is not None
        self._optimizers = [
            _optimizer(parameter, selective) for parameter in self._parameters.values()
        ]
        self._target = random_target(workload.cameras)
        self._fused_ssim = import_module(FUSED_SSIM).fused_ssim if find_spec(FUSED_SSIM) else None

    def run(self) -> None:
        """Do one step."""
        of, cameras = self._parameters, self._cameras
        picture, _, meta = self._gsplat.rasterization(
            means=of["means"],
            quats=of["quats"],
            scales=of["scales"].exp(),
            opacities=of["opacities"].sigmoid(),
            colors=torch.cat([of["sh0"], of["shN"]], dim=1),
            viewmats=cameras.world_to_camera,
            Ks=cameras.intrinsics,
            width=cameras.width,
            height=cameras.height,
            sh_degree=SH_DEGREE,
            packed=False,
        )
        meta["means2d"].retain_grad()  # As its strategy asks in every step.
        self._loss(picture).backward()
        for optimizer in self._optimizers:
            if self._selective:
                optimizer.step((meta["radii"] > 0).flatten(2).all(2).any(0))
            else:
                optimizer.step()
            optimizer.zero_grad(set_to_none=True)

    def _loss(self, picture: Tensor) -> Tensor:
        if self._fused_ssim is None:
            l1, dissimilarity = self._operators.l1_dssim(picture, self._target)
            return (1.0 - SSIM_WEIGHT) * l1 + SSIM_WEIGHT * dissimilarity
        pictures = (tensor.permute(0, 3, 1, 2) for tensor in (picture, self._target))
        similarity = self._fused_ssim(*pictures, padding="valid")
        l1 = l1_loss(picture, self._target)
        return (1.0 - SSIM_WEIGHT) * l1 + SSIM_WEIGHT * (1.0 - similarity)


def _optimizer(parameter: Tensor, selective: Any) -> Any:  # noqa: ANN401
    """One per tensor, as gsplat's strategies need it."""
    groups = [{"params": parameter, "lr": RATE}]
    if selective is not None:
        return selective(groups, eps=EPSILON, betas=BETAS)
    return torch.optim.Adam(groups, eps=EPSILON, betas=BETAS, fused=True)
