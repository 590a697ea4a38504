"""A small scene that moves: a model whose splats drift, images of it, and a method to train."""

from dataclasses import dataclass, replace

import torch

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.column import Column, Rows
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.evaluation import render_model
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig, StaticGaussiansOptim
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.methods.gaussians3d.model import GaussianParameters, StaticGaussians
from gsfw.plugins.specs import Spec, hookimpl
from support.fast_rasterizer import fast_rasterizer
from support.scenes import front_camera

SMALL_MOVING_SCENE = (
    "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "datamanager.moving=true",
    "datamanager.times=3", "steps=5",
)  # fmt: skip
"""Settings of a run on the built-in scene that moves."""

WHITE = RenderSettings(background=torch.ones(3))
RATES = StaticGaussiansOptim().learning_rates(1.0)


class DriftingGaussians(StaticGaussians):
    """Splats that move along straight lines."""

    def __init__(self, start, rates, velocities) -> None:
        super().__init__(start, rates)
        self.velocities = Column(velocities, LearningRate(1e-3))

    def columns(self):
        return {**super().columns(), "velocities": self.velocities}

    def splats(self, time=None, cameras=None):
        splats = super().splats()
        if time is None:
            return splats
        return replace(splats, means=splats.means + time * self.velocities.values)

    def rows_at(self, points, colors, sizes, time):
        fresh = super().rows_at(points, colors, sizes, time)
        return {**fresh, "velocities": Rows(torch.zeros_like(points))}


class DriftingMethod(StaticGaussiansMethod):
    """3DGS whose splats may drift."""

    def build_model(self, scene, operators, generator, initial):
        model = super().build_model(scene, operators, generator, initial)
        sh = torch.cat([model.sh_dc.values, model.sh_rest.values], dim=1)
        start = GaussianParameters(
            *(
                column.values.detach()
                for column in (model.means, model.quats, model.log_scales, model.opacity_logits)
            ),
            sh=sh.detach(),
        )
        rates = self.config.optim.learning_rates(scene.extent)
        velocities = torch.zeros_like(start.means)
        velocities[:, 0] = 0.3
        return DriftingGaussians(start, rates, velocities)


@dataclass
class DriftingConfig(StaticGaussiansConfig):
    ignore_time: bool = True

    def build(self):
        return DriftingMethod(self)


class DriftingPlugin:
    """What a package would register."""

    @hookimpl
    def gsfw_methods(self):
        return [Spec("drifting", "splats that drift", f"{__name__}:DriftingConfig")]


def two_balls(velocity: float = 0.8) -> DriftingGaussians:
    """A red ball that drifts to the right, and a blue one that stands below it."""
    sh = torch.zeros(2, 1, 3)
    sh[0, 0, 0], sh[1, 0, 2] = 1.7, 1.7
    sh[0, 0, 1:], sh[1, 0, :2] = -1.7, -1.7
    start = GaussianParameters(
        means=torch.tensor([[-0.4, -0.4, 0.0], [0.0, 0.5, 0.0]]),
        quats=torch.tensor([[1.0, 0, 0, 0]]).repeat(2, 1),
        log_scales=torch.full((2, 3), 0.12).log(),
        opacity_logits=torch.full((2,), 4.0),
        sh=sh,
    )
    return DriftingGaussians(start, RATES, torch.tensor([[velocity, 0, 0], [0.0, 0, 0]]))


def camera_at(time: float | None, distance: float = 3.0) -> Cameras:
    """A camera in front of the balls, at a time."""
    camera = front_camera(32, 24, distance)
    return camera if time is None else replace(camera, time=torch.tensor([time]))


class MovingImages(DataManager):
    """True images of the balls; views are (time, distance) of each split."""

    def __init__(self, held_out, train=((0.0, 5.0), (1.0, 5.0)), mask=None, valid=None) -> None:
        self.mask, self.valid = mask, valid
        self.split = {
            split: Views(
                tuple(f"{split.value}_{index}" for index in range(len(moments))),
                tuple(camera_at(*moment) for moment in moments),
            )
            for split, moments in ((Split.TRAIN, train), (Split.EVAL, held_out))
        }
        truth, rasterizer = two_balls(), fast_rasterizer()
        self.images = {
            split: [
                render_model(
                    truth, rasterizer, c, WHITE, None if c.time is None else c.time[0]
                ).color
                for c in views.cameras
            ]
            for split, views in self.split.items()
        }

    @property
    def scene(self) -> Scene:
        times = {time for views in self.split.values() for time in views.times or ()}
        points = torch.zeros(0, 3)
        dynamic = len(times) > 1
        return Scene(
            "balls", points, points, torch.zeros(1, 3), 1.0,
            time_range=(10.0, 14.0) if dynamic else None, num_times=len(times) if dynamic else 0,
        )  # fmt: skip

    def views(self, split):
        return self.split[split]

    def load(self, split, indices, device):
        views = self.split[split]
        return [
            Batch(
                torch.cat([self.images[split][i] for i in group]),
                Cameras.cat([views.cameras[i] for i in group]),
                group,
                mask=None if self.valid is None else self.valid[None],
            )
            for group in views.groups(indices)
        ]

    def moving_mask(self, split, index):
        return self.mask
