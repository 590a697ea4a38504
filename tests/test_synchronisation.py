"""No ordinary step lets the host wait for the device: it runs where there is nothing to wait for.

On torch's device "meta" tensors have shapes and no values: whatever reads one raises an error where
it stands. What a GPU would wait for without reading (a copy from the memory of the host, an index
that lies there) is caught by watching every operation.
"""

import traceback
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from support.composed_runs import composed, trainer_drawn_by
from support.sampling import sampled
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from gsfw.core.capabilities import Capabilities
from gsfw.core.loop.resolution import ResolutionSchedule
from gsfw.core.loop.trainer import Trainer
from gsfw.core.operators import Operators
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth

META = torch.device("meta")

SCENE = (
    *("datamanager.views=6", "datamanager.eval_views=2", "datamanager.points=150"),
    *("datamanager.width=96", "datamanager.height=96"),
)
"""Images large enough to be trained on at two thirds of their size."""

# Whole compositions; shapes are checked by the tests of the parts.
pytestmark = pytest.mark.unchecked

REFINES_AT = 30
"""Steps done when rows are first edited, which has to count them."""


class Smear(Rasterizer):
    """Gives every pixel the mean of all splats: differentiable, and made of plain operations."""

    @classmethod
    def capabilities(cls) -> Capabilities:
        return Capabilities(devices=frozenset({"meta"}))

    def _render(self, splats, cameras, settings):
        statistics = RenderStatistics.zeros(splats.means, len(cameras), settings.statistics)
        color = splats.colors.dense().mean((0, 1)) + splats.means.mean(0)
        alpha = splats.opacities.mean() * splats.scales.mean() * splats.quats.mean()
        shape = (len(cameras), cameras.height, cameras.width)
        alpha = alpha.expand(*shape, 1)
        depth = None if settings.depth is Depth.NONE else alpha.detach()
        return RenderOutput(color * alpha, alpha, statistics, depth)


class Anywhere(Operators):
    """Calls each row its own neighbour: real ones are found once, for which a run may wait."""

    def neighbors(self, points, k):
        return torch.arange(len(points), device=points.device)[:, None].expand(-1, k)


def place() -> str:
    """The line of gsfw that is being executed."""
    lines = [f for f in traceback.extract_stack() if "/tests/" not in f.filename]
    own = [f for f in lines if "/site-packages/" not in f.filename and "/lib/" not in f.filename]
    return f"{own[-1].filename}:{own[-1].lineno} {own[-1].line}" if own else "?"


class Copies(TorchDispatchMode):
    """Notes every operation that takes tensors of the host to the device, or would on a GPU."""

    def __init__(self, seed: int) -> None:
        super().__init__()
        self.found: list[str] = []
        self.seed = seed

    def __torch_dispatch__(self, function, types, args=(), kwargs=None):
        result = function(*args, **(kwargs or {}))
        given = [leaf for leaf in tree_leaves((args, kwargs)) if isinstance(leaf, Tensor)]
        # A single number of the host is handed to a kernel as one, except by these.
        scalars_too = any(word in str(function) for word in ("copy", "where", "index"))
        host = [t for t in given if t.device.type == "cpu" and (t.dim() > 0 or scalars_too)]
        there = [t for t in [*given, *tree_leaves(result)] if isinstance(t, Tensor) and t.is_meta]
        if host and there:
            self.found.append(f"{function} at {place()}")
        generator = (kwargs or {}).get("generator")
        # The run's own is one of the GPU where there is one; there is none of "meta".
        if generator is not None and there and generator.initial_seed() != self.seed:
            self.found.append(f"{function} draws from a generator of the host at {place()}")
        return result


class Constants(TorchFunctionMode):
    """Notes tensors that are made of Python's numbers on the device: torch copies them there."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def __torch_function__(self, function, types, args=(), kwargs=None):
        result = function(*args, **(kwargs or {}))
        made = (torch.tensor, torch.as_tensor, torch.from_numpy, Tensor.new_tensor)
        if function in made and result.is_meta:
            self.found.append(f"{function.__name__} at {place()}")
        return result


def trainer_on_meta(folder, *typed: str) -> Trainer:
    """A run on the built-in scene, as it would be composed for a GPU, before its second step."""
    found = composed(dict(item.split("=") for item in (*SCENE, *typed)))
    background = found.plan.settings.background.to(META)
    plan = replace(
        found.plan,
        settings=replace(found.plan.settings, background=background),
        log_every=1000,
        max_skipped=1000,
        resolution=ResolutionSchedule(((0, 1.5), (10, 1.0))),
    )
    parts = replace(found.parts, model=found.parts.model.to(META), device=META)
    found = replace(found, parts=parts, plan=plan)
    trainer = trainer_drawn_by(folder, found, Smear(), Anywhere())
    trainer.step = 1  # The first step is logged.
    return trainer


def watched(trainer: Trainer, steps: int) -> list[str]:
    """What copied between host and device during some steps."""
    copies, constants = Copies(trainer.parts.generator.initial_seed()), Constants()
    with copies, constants:
        for _ in range(steps):
            trainer._one_step()
    return [*copies.found, *constants.found]


REFINING = ("strategy.refine_every=15", f"strategy.refine_start={REFINES_AT - 15}")

MOVING = ("strategy=none", "rescale=false", "datamanager.moving=true", "datamanager.times=2")

RUNS = {
    "adc": ("strategy=adc", "strategy.reset_every=4", *REFINING),
    "budget": ("strategy=adc", "strategy.budget=auto", *REFINING),
    "absgrad": ("strategy=adc", "strategy.absgrad=true", "random_background=true"),
    "error": ("strategy=error", "strategy.views=15", "strategy.refine_every=15"),
    "mcmc": ("strategy=mcmc", "sampler.views_per_step=2", *REFINING),
    "mcmc by gradient": ("strategy=mcmc", "strategy.gradient_share=0.5"),
    "guided": ("strategy=adc", "strategy.guided.rounds=2", "strategy.guided.start=0", *REFINING),
    "error-weighted": ("strategy=none", "sampler=error-weighted"),
    "none": ("strategy=none", "sh_degree_interval=3"),
    "4dgs": ("method=4dgs", "coarse_steps=0", *MOVING),
    "dynamic3dgs": ("method=dynamic3dgs", "sampler.first_steps=1", *MOVING),
}


@pytest.mark.parametrize("name", sampled([(name,) for name in RUNS], [0]))
def test_an_ordinary_step_neither_reads_from_the_device_nor_copies_to_it(tmp_path, name):
    trainer = trainer_on_meta(tmp_path, *RUNS[name])
    trainer._one_step()  # Cameras, images and windows come to the device once.
    go_to(trainer, 11)
    trainer._one_step()  # Images are full from now on.
    go_to(trainer, 2)
    assert watched(trainer, 1) == [], "small images"
    go_to(trainer, 12)
    assert watched(trainer, 2) == [], "full images"


def go_to(trainer: Trainer, step: int) -> None:
    """Jump to a step of the schedule, as if the sampler had been asked at every step before."""
    trainer.step = trainer.walk._drawn = step


@pytest.mark.parametrize(
    "spoil",
    [
        float,
        lambda loss: loss if loss > 0 else -loss,
        lambda loss: loss * torch.stack([loss, loss])[torch.stack([loss > 0, loss < 0])].sum(),
        lambda loss: loss.cpu(),
        lambda loss: loss * torch.ones(2).to(loss.device).sum(),
        lambda loss: loss * torch.tensor([1.0, 2.0], device=loss.device).sum(),
        lambda loss: loss * torch.stack([loss, loss])[torch.tensor([0])].sum(),
        lambda loss: loss * torch.rand((), generator=torch.Generator(), device=loss.device),
    ],
    ids=["float", "branch", "mask", "cpu", "to", "constant", "index", "generator"],
)
def test_what_would_wait_is_seen(tmp_path, monkeypatch, spoil: Callable[[Tensor], Tensor]):
    trainer = trainer_on_meta(tmp_path, *RUNS["none"])
    watched(trainer, 1)
    trainer.step = 2
    plain = Operators.l1_dssim

    def spoiled(self, *images):
        l1, dssim = plain(self, *images)
        return spoil(l1), dssim

    monkeypatch.setattr(Operators, "l1_dssim", spoiled)
    try:
        found = watched(trainer, 1)
    except (RuntimeError, NotImplementedError, TypeError) as error:
        found = [str(error)]
    assert found


def test_a_refinement_does_wait(tmp_path):
    trainer = trainer_on_meta(tmp_path, *RUNS["adc"])
    trainer.step = REFINES_AT - 1
    with pytest.raises((RuntimeError, NotImplementedError)):
        watched(trainer, 1)
