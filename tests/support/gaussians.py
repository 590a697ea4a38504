"""Small trainable Gaussians, for tests of methods, strategies and the loop."""

from dataclasses import replace

import torch

from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.table import SplatTable
from gsfw.methods.gaussians3d.config import StaticGaussiansOptim
from gsfw.methods.gaussians3d.initialisation import from_splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from support.scenes import front_camera, random_splats

EXTENT = 2.0


def toy_scene(num_points: int = 0, **options) -> Scene:
    points = torch.rand(num_points, 3, generator=torch.Generator().manual_seed(0))
    centers = torch.tensor([[0.0, 0, -4], [1, 0, -4]])
    return replace(Scene("toy", points, points.clone(), centers, EXTENT), **options)


def gaussians(n: int = 20, degree: int = 1, seed: int = 0) -> StaticGaussians:
    start = from_splats(random_splats(n, degree=degree, seed=seed), degree)
    return StaticGaussians(start, StaticGaussiansOptim().learning_rates(EXTENT))


def set_rows(model: StaticGaussians, opacities=None, sizes=None) -> None:
    """Give rows these opacities and (round) sizes."""
    with torch.no_grad():
        if opacities is not None:
            model.opacity_logits.values.copy_(torch.tensor(opacities).logit())
        if sizes is not None:
            model.log_scales.values.copy_(torch.tensor(sizes).log()[:, None].expand(-1, 3))


def table_of(model: StaticGaussians) -> tuple[Optimizer, SplatTable]:
    """A table whose optimizer has moments of one everywhere."""
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    for name, column in model.columns().items():
        for moments in optimizer.moments(name) if column.trained else ():
            moments.first.fill_(1.0)
            moments.second.fill_(1.0)
    return optimizer, SplatTable(model, optimizer)


def no_views(cameras, time=None):
    """Pseudo views, where a test has no renderer."""
    raise NotImplementedError


def no_contributions(weights):
    """Weighted contributions, where a test has no renderer."""
    raise NotImplementedError


def context_of(
    statistics: RenderStatistics,
    num_rows: int,
    step: int = 0,
    share: float = 1.0,
    splats: Splats | None = None,
) -> StepContext:
    """A context with as many views as the statistics have."""
    views = statistics.visible.shape[0]
    images = torch.zeros(views, 2, 3, 3)
    camera = front_camera(3, 2)
    return StepContext(
        step=step,
        steps=100,
        batch=Batch(images, camera.select([0] * views), tuple(range(views))),
        splats=random_splats(num_rows) if splats is None else splats,
        rendered=RenderOutput(images, torch.zeros(views, 2, 3, 1), statistics),
        target=images,
        num_rows=num_rows,
        share=share,
        extent=EXTENT,
        operators=Operators(),
        render=no_views,
        contributions=no_contributions,
    )
