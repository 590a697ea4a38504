"""Whole trainings on a small capture in memory, in parts that tests replace."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch

from gsfw.core.batch import Batch
from gsfw.core.callback import Callback, RunInfo
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.core.loop.training_parts import TrainingParts, TrainingPlan
from gsfw.core.method import Method
from gsfw.core.metrics import Psnr
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.refinement.refiners import Refiners
from gsfw.core.refiner import Refiner
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.core.table import SplatTable
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.samplers.uniform import UniformSampler
from gsfw.strategies.adc import AdcConfig
from gsfw.strategies.error_growth import ErrorGrowthConfig
from gsfw.strategies.mcmc import McmcConfig
from gsfw.strategies.none import NoneConfig
from support.fast_rasterizer import fast_rasterizer
from support.gaussians import EXTENT
from support.scenes import front_camera, random_splats

CPU, USUAL = torch.device("cpu"), OptimizerSettings()
TRUTH = random_splats(100, degree=0)

STRATEGIES = {
    "adc": AdcConfig(
        refine_start=5, refine_stop=50, refine_every=10, grow_gradient=2e-4, reset_every=25,
        reset_opacity=0.1,
    ),
    "absgrad": AdcConfig(
        refine_start=5, refine_stop=50, refine_every=10, grow_gradient=4e-4, absgrad=True,
    ),
    "error": ErrorGrowthConfig(
        refine_start=5, refine_stop=50, refine_every=10, views=7, max_gaussians=130,
    ),
    "mcmc": McmcConfig(refine_start=5, refine_stop=50, refine_every=10, cap_max=130),
    "none": NoneConfig(),
}  # fmt: skip


def camera(index: int, width: int = 32, height: int = 24, count: int = 8) -> Cameras:
    """One of ``count`` cameras around the scene."""
    angle = torch.tensor(index * 2 * torch.pi / count)
    turn = torch.eye(4)
    turn[0, 0], turn[0, 2], turn[2, 0], turn[2, 2] = (
        angle.cos(), angle.sin(), -angle.sin(), angle.cos(),
    )  # fmt: skip
    front = front_camera(width, height)
    return replace(front, world_to_camera=front.world_to_camera @ turn)


class MemoryData(DataManager):
    """Pictures of known splats, drawn once and kept."""

    def __init__(self, sizes: tuple[tuple[int, int], ...] = ((32, 24),)) -> None:
        cameras = [camera(i, *sizes[i % len(sizes)]) for i in range(8)]
        self.split = {
            Split.TRAIN: Views(tuple(f"t{i}" for i in range(6)), tuple(cameras[:6])),
            Split.EVAL: Views(("e0", "e1"), tuple(cameras[6:])),
        }
        with torch.no_grad():
            outputs = [fast_rasterizer().render(TRUTH, item) for item in cameras]
        pictures = [output.color.clamp(0, 1) for output in outputs]
        self.pictures = {Split.TRAIN: pictures[:6], Split.EVAL: pictures[6:]}

    @property
    def scene(self) -> Scene:
        jitter = torch.randn(100, 3, generator=torch.Generator().manual_seed(1))
        centers = torch.cat([item.centers for item in self.split[Split.TRAIN].cameras])
        points = TRUTH.means + 0.05 * jitter
        return Scene("memory", points, torch.full_like(points, 0.5), centers, EXTENT)

    def views(self, split: Split) -> Views:
        return self.split[split]

    def load(self, split, indices, device) -> list[Batch]:
        views, pictures = self.split[split], self.pictures[split]
        return [
            Batch(
                torch.cat([pictures[i] for i in group]),
                Cameras.cat([views.cameras[i] for i in group]),
                group,
            )
            for group in views.groups(indices)
        ]


class Recorder(Callback):
    """Remembers reports, and stops the run where it is told to."""

    def __init__(self, stop_at: int | None = None) -> None:
        self.stop_at = stop_at
        self.reports = []
        self.evaluated, self.saved = [], []

    def on_step(self, report, control) -> None:
        self.reports.append(report)

    def on_evaluation(self, step, evaluation, control) -> None:
        self.evaluated.append(step)

    def on_checkpoint(self, step, path) -> None:
        self.saved.append(step)

    def on_tick(self, step, control) -> None:
        if step == self.stop_at:
            control.request_stop("the test says so")


class Poisoned(StaticGaussiansMethod):
    """Its loss is not a number at the given steps."""

    def __init__(self, config, steps) -> None:
        super().__init__(config)
        self.steps = steps

    def losses(self, context):
        losses = dict(super().losses(context))
        if context.step in self.steps:
            losses["poison"] = losses["l1"] * torch.nan
        return losses


def trainer(
    folder: Path, strategy: str, callback: Callback, poisoned=(), views_per_step=1,
    sizes=((32, 24),), seed=3, **plan,
) -> Trainer:  # fmt: skip
    config = StaticGaussiansConfig(seed=seed, sh_degree=1, sh_degree_interval=20, init_opacity=0.3)
    config.optim.means_lr_steps = 60
    method = Poisoned(config, poisoned) if poisoned else config.build()
    data = MemoryData(sizes)
    seeded = torch.Generator().manual_seed(config.seed)
    model = method.build_model(data.scene, Operators(), seeded, None)
    refiners = STRATEGIES[strategy].refiners(data.scene)
    parts = parts_of(data, method, model, refiners, config.seed, views_per_step)
    return trainer_of(parts, folder, [callback], **{"steps": 60} | plan)


def parts_of(
    data: DataManager, method: Method, model: PrimitiveModel, refiners: Sequence[Refiner] = (),
    seed: int = 0, views_per_step: int = 1, optim: OptimizerSettings = USUAL,
) -> TrainingParts:  # fmt: skip
    """The parts of a run on the CPU, with torch's own operators."""
    operators = Operators()
    optimizer = Optimizer(model, operators, optim)
    return TrainingParts(
        method=method,
        model=model,
        optimizer=optimizer,
        table=SplatTable(model, optimizer),
        refiners=Refiners(refiners),
        sampler=UniformSampler(len(data.views(Split.TRAIN)), views_per_step, seed),
        data=data,
        rasterizer=fast_rasterizer(),
        operators=operators,
        metrics={"psnr": Psnr()},
        generator=torch.Generator().manual_seed(seed + 1),
        device=CPU,
    )


def trainer_of(
    parts: TrainingParts, folder: Path, callbacks: Sequence[Callback], **plan
) -> Trainer:
    """A trainer that logs every step, and writes a checkpoint at the end alone unless told."""
    settings = RenderSettings(background=torch.zeros(3))
    whole = TrainingPlan(
        settings=settings, **{"log_every": 1, "eval_every": 0, "checkpoint_every": 0} | plan
    )
    info = RunInfo(folder, "3dgs", "memory", whole.steps, 0, {}, {})
    return Trainer(parts, whole, RunFolder(folder), info, callbacks)


def with_parts(run: Trainer, **parts: object) -> Trainer:
    """A trainer with some other parts."""
    return Trainer(replace(run.parts, **parts), run.plan, run.folder, run.info, [run.callbacks])
