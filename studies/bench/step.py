"""Step: one step of method 3dgs on a workload, from parameters to moved parameters."""

from __future__ import annotations

from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

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
from gsfw.studies.bench.scene import SEED
from gsfw.studies.bench.timing import Timings, total
from gsfw.studies.bench.workload import Workload

SH_DEGREE = 3
SSIM_WEIGHT = 0.2
"""As in Kerbl et al. 2023, equation 7."""

RATE = 1e-9
"""Of every column: all of Adam's work is done, and yet each repeat draws the same picture."""

COLUMNS = ("means", "log_scales", "quats", "opacity_logits", "sh_dc", "sh_rest")


class TrainingStep:
    """Splats -> render -> loss -> backward -> check -> optimizer, as the trainer does it.

    What a trainer does besides (loading views, density control, writing) is not measured.
    """

    def __init__(self, workload: Workload, operators: Operators, sparse: bool = False) -> None:
        """Steps on a workload, with plain Adam or, when ``sparse``, only of rows that are seen."""
        device = workload.cameras.world_to_camera.device
        start = from_splats(with_harmonics(workload.to(torch.device("cpu")).splats), SH_DEGREE)
        rates = {name: LearningRate(RATE) for name in COLUMNS}
        self._model = StaticGaussians(start, rates).to(device)
        self._optimizer = Optimizer(self._model, operators, OptimizerSettings(sparse=sparse))
        self._operators = operators
        self._cameras = workload.cameras
        self._target = random_target(self._cameras)

    def run(self, rasterizer: Rasterizer, settings: RenderSettings) -> None:
        """Do one step that is not measured part by part."""
        self.measure(rasterizer, settings, Timings())

    def measure(self, rasterizer: Rasterizer, settings: RenderSettings, timings: Timings) -> None:
        """Do one step; adds what it and each of its parts took.

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
        """The loss, and its gradient with respect to the picture, [c, h, w, 3].

        Cut off from what drew the picture, so that its backward pass is measured with it.
        """
        picture = color.detach().requires_grad_()
        l1, dssim = self._operators.l1_dssim(picture, self._target)
        loss = (1.0 - SSIM_WEIGHT) * l1 + SSIM_WEIGHT * dssim
        loss.backward()
        assert picture.grad is not None
        return loss.detach(), picture.grad


def random_target(cameras: Cameras) -> Float[Tensor, "c h w 3"]:
    """Pictures that are compared with, where the cameras are."""
    shape = (len(cameras), cameras.height, cameras.width, 3)
    target = torch.rand(shape, generator=torch.Generator().manual_seed(SEED))
    return target.to(cameras.world_to_camera.device)


def with_harmonics(splats: Splats) -> Splats:
    """The same splats, with plain colours as the constant coefficient."""
    if isinstance(splats.colors, Sh):
        return splats
    return replace(splats, colors=Sh(rgb_to_dc(splats.colors)[:, None], 0))
