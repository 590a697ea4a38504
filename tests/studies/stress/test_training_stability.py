"""Training on what breaks training: section 13 of the catalogue of extremes.

What is skipped, counted, resumed and refused in general is in core/test_trainer.py,
core/test_optimizer.py and strategies/.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from pathlib import Path

import pytest
import torch
from support.fast_rasterizer import fast_rasterizer
from support.memory_training import parts_of, trainer_of
from support.scenes import front_camera, random_splats
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from gsfw.callbacks.tensorboard import TensorBoard
from gsfw.core.batch import Batch, MaskMode
from gsfw.core.callback import Callback
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.errors import TrainingError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.trainer import Trainer
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.strategies.adc import AdcConfig
from gsfw.strategies.error_growth import ErrorGrowthConfig
from gsfw.strategies.mcmc import McmcConfig

# Whole trainings and scenes; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

CPU = torch.device("cpu")
STEPS = 16
SIZE = (16, 12)
TRUTH = random_splats(40, degree=0)

STRATEGIES = {
    "adc": AdcConfig(
        refine_start=3, refine_stop=14, refine_every=4, grow_gradient=2e-4, reset_every=8,
        reset_opacity=0.1,
    ),
    "error": ErrorGrowthConfig(
        refine_start=3, refine_stop=14, refine_every=4, views=2, max_gaussians=60,
    ),
    "mcmc": McmcConfig(refine_start=3, refine_stop=14, refine_every=4, cap_max=60),
}  # fmt: skip


@dataclass
class Capture(DataManager):
    """Images of known splats, with something wrong."""

    views_count: int = 4
    factor: float = 1.0
    """Of the images; 0: black."""
    mask: MaskMode | None = None
    """Of a mask that lets no pixel through."""
    points: torch.Tensor | None = None

    def __post_init__(self) -> None:
        cameras = [front_camera(*SIZE, 4.0 + 0.1 * i) for i in range(self.views_count)]
        train = Views(tuple(f"t{i}" for i in range(len(cameras))), tuple(cameras))
        self.split = {Split.TRAIN: train, Split.EVAL: Views(("e0",), (front_camera(*SIZE),))}

    @property
    def scene(self) -> Scene:
        points = TRUTH.means if self.points is None else self.points
        centers = torch.cat([camera.centers for camera in self.split[Split.TRAIN].cameras])
        return Scene("broken", points, torch.full_like(points, 0.5), centers, 4.0)

    def views(self, split: Split) -> Views:
        return self.split[split]

    def load(self, split, indices, device) -> list[Batch]:
        batches = []
        for group in self.split[split].groups(indices):
            cameras = Cameras.cat([self.split[split].cameras[i] for i in group])
            with torch.no_grad():
                images = self.factor * fast_rasterizer().render(TRUTH, cameras).color
            batch = Batch(images.clamp(0, 1), cameras, group)
            if self.mask is not None:
                nothing = torch.zeros(*images.shape[:3], 1, dtype=torch.bool)
                batch = replace(batch, mask=nothing, mask_mode=self.mask)
            batches.append(batch)
        return batches


class Spiking(StaticGaussiansMethod):
    """Its loss, or only its gradient, is not finite at the given steps."""

    def __init__(self, config, steps: Iterable[int], gradient_only: bool) -> None:
        super().__init__(config)
        self.steps, self.gradient_only = set(steps), gradient_only

    def losses(self, context):
        losses = dict(super().losses(context))
        if context.step in self.steps:
            means = context.splats.means
            # The square root of 0 is 0, and its derivative is not finite.
            losses["spike"] = (
                (means - means.detach()).square().sum().sqrt()
                if self.gradient_only
                else losses["l1"] * torch.inf
            )
        return losses


def trainer(
    folder: Path, data: DataManager, strategy: str = "adc", rates: float = 1.0,
    spikes: Iterable[int] = (), gradient_only: bool = False,
    callbacks: tuple[Callback, ...] = (), **plan,
) -> Trainer:  # fmt: skip
    config = StaticGaussiansConfig(sh_degree=1, sh_degree_interval=5, init_opacity=0.3)
    for item in fields(config.optim):
        value = getattr(config.optim, item.name)
        if item.name.endswith(("_lr", "_lr_final")) and isinstance(value, float):
            setattr(config.optim, item.name, rates * value)
    method = Spiking(config, spikes, gradient_only)
    model = method.build_model(data.scene, Operators(), torch.Generator().manual_seed(0), None)
    refiners, optim = STRATEGIES[strategy].refiners(data.scene), config.optim.settings(config.steps)
    parts = parts_of(data, method, model, refiners, optim=optim)
    return trainer_of(parts, folder, callbacks, **{"steps": STEPS} | plan)


def check_finite(run: Trainer) -> None:
    """Everything that is trained, and everything that was written."""
    for name, column in run.parts.model.columns().items():
        assert column.values.isfinite().all(), name
    checkpoint = run.folder.latest_checkpoint()
    assert checkpoint is not None
    state = read_checkpoint(checkpoint)
    floating = [
        t for t in tensors_of((state["model"], state["optimizer"])) if t.is_floating_point()
    ]
    assert all(bool(tensor.isfinite().all()) for tensor in floating)


def tensors_of(state) -> list[torch.Tensor]:
    if isinstance(state, torch.Tensor):
        return [state]
    if isinstance(state, dict):
        state = list(state.values())
    if isinstance(state, list | tuple):
        return [tensor for item in state for tensor in tensors_of(item)]
    return []


POINTS = TRUTH.means

BROKEN = {
    "one image": Capture(views_count=1),
    "black images": Capture(factor=0.0),
    "a mask that ignores every pixel": Capture(mask=MaskMode.IGNORE),
    "a mask that empties every pixel": Capture(mask=MaskMode.EMPTY),
    "duplicate points": Capture(points=POINTS.repeat(3, 1)),
    "all points in one place": Capture(points=torch.zeros(40, 3)),
    "points on the cameras": Capture(
        points=torch.cat([POINTS, torch.tensor([[0.0, 0.0, -4.0], [0.0, 0.0, -4.1]]), POINTS - 4])
    ),
    "points very far away": Capture(points=torch.cat([POINTS, 1e8 * POINTS])),
}


@pytest.mark.slow
@pytest.mark.parametrize("strategy", STRATEGIES)
@pytest.mark.parametrize("name", BROKEN)
def test_training_on_broken_captures_stays_finite(tmp_path, name, strategy):
    run = trainer(tmp_path, BROKEN[name], strategy)
    summary = run.fit()
    assert summary["skipped_steps"] == 0
    check_finite(run)


@pytest.mark.parametrize("strategy", STRATEGIES)
def test_learning_rates_times_a_hundred_leave_finite_parameters(tmp_path, strategy):
    run = trainer(tmp_path, Capture(), strategy, rates=100.0)
    run.fit()
    check_finite(run)
    splats = run.parts.model.splats()
    assert ReferenceRasterizer().render(splats, front_camera(*SIZE)).color.isfinite().all()


@pytest.mark.parametrize("gradient_only", [False, True])
def test_a_spike_to_infinity_is_skipped_counted_and_shown_in_tensorboard(tmp_path, gradient_only):
    run = trainer(
        tmp_path, Capture(), spikes=[5, 9], gradient_only=gradient_only, callbacks=(TensorBoard(4),)
    )
    assert run.fit()["skipped_steps"] == 2
    check_finite(run)
    events = EventAccumulator(str(tmp_path / "tb"))
    events.Reload()
    counts = {event.step: event.value for event in events.Scalars("2_quality/skipped_steps")}
    assert [counts[step] for step in (5, 6, 9, 10, STEPS)] == [0, 1, 1, 2, 2]


@pytest.mark.parametrize("gradient_only", [False, True])
def test_spikes_in_a_row_stop_the_run_with_advice_and_a_finite_checkpoint(tmp_path, gradient_only):
    run = trainer(
        tmp_path, Capture(), spikes=range(6, STEPS), gradient_only=gradient_only, max_skipped=3
    )
    with pytest.raises(TrainingError, match="Try lower learning rates") as caught:
        run.fit()
    assert caught.value.message == (
        "3 steps in a row had a loss or gradient that is not finite; stopped at step 9."
        + ("" if gradient_only else " Loss terms that are not finite: spike.")
    )
    check_finite(run)
