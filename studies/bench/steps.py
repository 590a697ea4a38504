"""Steps: one training step on a workload, as method 3dgs and as gsplat's own trainer do it.

By default gsplat's examples/simple_trainer.py (Apache-2.0; read, not copied) has SH degree 3 in two
tensors, ``packed=False``, 0.8 L1 + 0.2 (1 - SSIM) with the fused-ssim package, and one fused Adam
per tensor; its ``visible_adam`` takes gsplat's SelectiveAdam instead. Where fused-ssim is not
installed, our fused operators stand in for it, so that the difference lies elsewhere.
"""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import l1_loss

from gsfw.core.cameras import Cameras
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.maths.spherical_harmonics import rgb_to_dc
from gsfw.core.operators import Operators
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Sh, Splats
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.rasterizers.gsplat import package
from gsfw.studies.bench.timing import Timings, total
from gsfw.studies.bench.workload import SEED, Workload

SH_DEGREE = 3
SSIM_WEIGHT = 0.2
"""As in Kerbl et al. 2023, equation 7."""

RATE = 1e-9
"""Learning rate of all columns: Adam does all of its work, yet each repeat renders the same."""

COLUMNS = ("means", "log_scales", "quats", "opacity_logits", "sh_dc", "sh_rest")

EPSILON, BETAS = 1e-15, (0.9, 0.999)

FUSED_SSIM = "fused_ssim"
"""A package that gsplat's trainer needs."""


class TrainingStep:
    """Splats -> render -> loss -> backward -> check -> optimizer, as the trainer does it.

    A trainer's other work (loading views, density control, writing) is not measured.
    """

    def __init__(self, workload: Workload, operators: Operators, sparse: bool = False) -> None:
        """Prepare steps with plain Adam or, when ``sparse``, with Adam for visible rows only."""
        device = workload.cameras.world_to_camera.device
        start = from_splats(with_harmonics(workload.to(torch.device("cpu")).splats), SH_DEGREE)
        rates = {name: LearningRate(RATE) for name in COLUMNS}
        self._model = StaticGaussians(start, rates).to(device)
        self._optimizer = Optimizer(self._model, operators, OptimizerSettings(sparse=sparse))
        self._operators = operators
        self._cameras = workload.cameras
        self._target = random_target(self._cameras)

    def run(self, rasterizer: Rasterizer, settings: RenderSettings) -> None:
        """Do one step without measuring its parts."""
        self.measure(rasterizer, settings, Timings())

    def measure(self, rasterizer: Rasterizer, settings: RenderSettings, timings: Timings) -> None:
        """Do one step; adds its time and the times of its parts.

        Where the rasterizer measures its stages, ``step_kernels`` is the time inside kernels: those
        stages, and loss, check and optimizer where the operators are not the plain torch ones.
        """
        model, optimizer = self._model, self._optimizer
        with timings.stage("step"):
            with timings.stage("activation"):
                splats = model.splats()
            with timings.stage("render"):
                output = rasterizer.render(splats, self._cameras, settings)
            with timings.stage("loss"):
                loss, gradient = self._loss(output.color)
            with timings.stage("step_backward"):
                output.color.backward(gradient)
            with timings.stage("check"):
                finite = self._operators.all_finite([loss, *optimizer.gradients()])
            with timings.stage("optimizer"):
                optimizer.step(0, finite, output.statistics.visible.any(0))
                optimizer.zero_gradients()
                model.project_()
        stages = [*rasterizer.stage_times().values()]
        if stages:
            if type(self._operators) is not Operators:
                stages += [timings.latest(name) for name in ("loss", "check", "optimizer")]
            timings.add("step_kernels", total(stages))

    def _loss(self, color: Tensor) -> tuple[Tensor, Tensor]:
        """The loss, and its gradient with respect to the image, [c, h, w, 3].

        The image is detached, so that the loss's backward pass is measured here.
        """
        image = color.detach().requires_grad_()
        l1, dssim = self._operators.l1_dssim(image, self._target)
        loss = (1.0 - SSIM_WEIGHT) * l1 + SSIM_WEIGHT * dssim
        loss.backward()
        assert image.grad is not None
        return loss.detach(), image.grad


def random_target(cameras: Cameras) -> Float[Tensor, "c h w 3"]:
    """Target images of a loss, on the device of the cameras."""
    shape = (len(cameras), cameras.height, cameras.width, 3)
    target = torch.rand(shape, generator=torch.Generator().manual_seed(SEED))
    return target.to(cameras.world_to_camera.device)


def with_harmonics(splats: Splats) -> Splats:
    """The same splats with SH; plain colours become the constant coefficient."""
    if isinstance(splats.colors, Sh):
        return splats
    return replace(splats, colors=Sh(rgb_to_dc(splats.colors)[:, None], 0))


def gsplat_steps(workload: Workload, operators: Operators, sparse: bool) -> dict[str, GsplatStep]:
    """Steps with gsplat's loss and optimizer, by the name of the figure."""
    gsplat = package.load()
    steps = {"own_step": GsplatStep(gsplat, workload, operators)}
    selective = getattr(import_module("gsplat.optimizers"), "SelectiveAdam", None)
    if sparse and selective is not None:
        steps["own_sparse_step"] = GsplatStep(gsplat, workload, operators, selective)
    return steps


def ssim_source() -> str:
    """Origin of the SSIM that these steps use."""
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
        """Prepare steps.

        Args:
            gsplat: the package.
            workload: to render.
            operators: for the loss where fused-ssim is missing.
            selective: an optimizer of visible rows only; ``None`` for plain Adam.
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
        image, _, meta = self._gsplat.rasterization(
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
        self._loss(image).backward()
        for optimizer in self._optimizers:
            if self._selective:
                optimizer.step((meta["radii"] > 0).flatten(2).all(2).any(0))
            else:
                optimizer.step()
            optimizer.zero_grad(set_to_none=True)

    def _loss(self, image: Tensor) -> Tensor:
        if self._fused_ssim is None:
            l1, dissimilarity = self._operators.l1_dssim(image, self._target)
            return (1.0 - SSIM_WEIGHT) * l1 + SSIM_WEIGHT * dissimilarity
        images = (tensor.permute(0, 3, 1, 2) for tensor in (image, self._target))
        similarity = self._fused_ssim(*images, padding="valid")
        l1 = l1_loss(image, self._target)
        return (1.0 - SSIM_WEIGHT) * l1 + SSIM_WEIGHT * (1.0 - similarity)


def _optimizer(parameter: Tensor, selective: Any) -> Any:  # noqa: ANN401
    """An optimizer of one tensor, as gsplat's strategies need it."""
    groups = [{"params": parameter, "lr": RATE}]
    if selective is not None:
        return selective(groups, eps=EPSILON, betas=BETAS)
    return torch.optim.Adam(groups, eps=EPSILON, betas=BETAS, fused=True)
