"""Strategies, methods and callbacks that break a promise: their runs train."""

import random
from dataclasses import dataclass, replace
from typing import ClassVar

import torch

from gsfw.core.callback import Callback
from gsfw.core.column import Column
from gsfw.core.config import StrategyConfig
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.resolution import MIN_SIDE
from gsfw.core.refiner import Refiner
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.methods.gaussians3d.model import StaticGaussians
from support.broken_parts.registry import OTHERS, breaks


class _Refiner(Refiner):
    name = "faulty"

    def __init__(self, edit):
        self._edit = edit

    def refine(self, context):
        return {} if context.done % 10 else self._edit(context)


def _strategy(promise: str, edit):
    name = f"Strategy_{promise.replace('-', '_')}"

    def refiners(self, scene):
        return (_Refiner(edit),)

    members = {"refiners": refiners, "__module__": __name__, "__doc__": "Faulty."}
    globals()[name] = breaks("strategy", promise)(dataclass(type(name, (StrategyConfig,), members)))


def _clone(context):
    rows = torch.arange(3)
    context.table.append(context.model.clone_rows(rows))
    return {"cloned": 3}


def _by_hand(context):
    column = next(iter(context.model.columns().values()))
    with torch.no_grad():
        column.values[0] = torch.nan
    return {}


def _at_random(context):
    rows = torch.randperm(len(context.table))[:3]
    context.table.append(context.model.clone_rows(rows))
    return {"cloned": 3}


_strategy("runs-with-3dgs", _by_hand)
_strategy("several-batches", _by_hand)
_strategy("not-finite-steps", _by_hand)
_strategy("respects-max-rows", _clone)
_strategy("respects-may-grow", _clone)
_strategy("respects-hold", _clone)
_strategy("uses-the-given-generator", _at_random)


class _Counting(_Refiner):
    """Clones by a counter that is in no state."""

    def __init__(self):
        super().__init__(self._grow)
        self._calls = 0

    def _grow(self, context):
        self._calls += 1
        rows = torch.arange(self._calls)
        context.table.append(context.model.clone_rows(rows))
        return {"cloned": self._calls}


@breaks("strategy", "resumes-to-the-same-bits")
@dataclass
class Unsaved(StrategyConfig):
    """A strategy with a state that it does not save."""

    def refiners(self, scene):
        return (_Counting(),)


def _method(promise: str, model_members=None, **members):
    name = f"Method_{promise.replace('-', '_')}"
    model = type("FaultyModel", (StaticGaussians,), model_members or {})
    method = type("FaultyMethod", (StaticGaussiansMethod,), {"model_class": model, **members})

    def build(self):
        return method(self)

    made = {"build": build, "__module__": __name__, "__doc__": "Faulty."}
    globals()[name] = breaks("method", promise)(
        dataclass(type(name, (StaticGaussiansConfig,), made))
    )


def _detached(self, context):
    found = StaticGaussiansMethod.losses(self, context)
    return {name: -value + 2 * value.detach() for name, value in found.items()}


def _weighted_by_a_counter(self, context):
    self.calls = getattr(self, "calls", 0) + 1
    found = StaticGaussiansMethod.losses(self, context)
    return {name: value * (1 + 0.01 * self.calls) for name, value in found.items()}


def _noisy(self, context):
    found = StaticGaussiansMethod.losses(self, context)
    return {name: value * (1 + 0.1 * torch.rand(())) for name, value in found.items()}


def _drifting(self, time=None, cameras=None):
    splats = StaticGaussians.splats(self, time, cameras)
    return splats if time is None else replace(splats, means=splats.means + time)


def _noisy_since_a_step(self, step, model, optimizer, time=None):
    model.noise = 0.01


def _with_noise(self, time=None, cameras=None):
    splats = StaticGaussians.splats(self, time, cameras)
    return replace(splats, means=splats.means + getattr(self, "noise", 0.0))


def _fading_with_distance(self, time=None, cameras=None):
    splats = StaticGaussians.splats(self, time, cameras)
    if cameras is None:
        return splats
    distances = (splats.means.detach() - cameras.centers[0]).norm(dim=1)
    return replace(splats, opacities=splats.opacities * (-0.1 * distances).exp())


def _half_of_the_columns(self, rows, generator=None):
    return dict(list(StaticGaussians.clone_rows(self, rows, generator).items())[:2])


def _changes_nothing(self, function):
    return ()


def _large_children(self, rows, copies, generator):
    return StaticGaussians.clone_rows(self, rows.repeat(copies))


def _needs_neighbours(self, scene, operators, generator, initial):
    assert len(scene.points) > 3, "neighbours"
    return StaticGaussiansMethod.build_model(self, scene, operators, generator, initial)


def _not_small(self, context):
    assert context.batch.cameras.width == 2 * MIN_SIDE, "the full size"
    return StaticGaussiansMethod.losses(self, context)


def _outside_state(self, time=None, cameras=None):
    splats = StaticGaussians.splats(self, time, cameras)
    self.shift = getattr(self, "shift", random.random())
    return replace(splats, means=splats.means + self.shift)


def _logits(self, time=None, cameras=None):
    splats = StaticGaussians.splats(self, time, cameras)
    return replace(splats, quats=splats.quats * 1.0, opacities=splats.opacities * 1.5)


def _with_another_argument(self, context, extra):
    return {}


_method("fits-its-contract", losses=_with_another_argument)
_method("learns", losses=_detached)
_method("resumes-to-the-same-bits", losses=_weighted_by_a_counter)
_method("uses-the-given-generator", losses=_noisy)
_method("is-evaluated-as-restored", {"splats": _with_noise}, prepare=_noisy_since_a_step)
_method("times-are-honoured", {"splats": _drifting})
_method("view-dependence-is-declared", {"splats": _fading_with_distance})
_method("edits-keep-columns", {"clone_rows": _half_of_the_columns})
_method("opacities-change-as-asked", {"change_opacities_": _changes_nothing})
_method("children-are-alike", {"split_rows": _large_children})
_method("runs-with-adc", {"split_rows": _half_of_the_columns, "clone_rows": _half_of_the_columns})
_method("one-gaussian", build_model=_needs_neighbours)
_method("runs-at-lower-resolution", losses=_not_small)
_method("model-file-renders-the-same", {"splats": _outside_state})
_method("export-renders-the-same", {"splats": _logits})


@dataclass
class NeedsFeatures(StaticGaussiansConfig):
    def build(self):
        return NeedsFeaturesMethod(self)


class NeedsFeaturesMethod(StaticGaussiansMethod):
    def build_model(self, scene, operators, generator, initial):
        raise ConfigError("the data has no map.")


@dataclass
class OneRowTooMany(StaticGaussiansConfig):
    def build(self):
        return OneRowTooManyMethod(self)


class OneRowTooManyMethod(StaticGaussiansMethod):
    def extra_columns(self, scene, count):
        return {"more": Column(torch.zeros(count + 1, 2), LearningRate(0.1))}


OTHERS |= {"needs-features": NeedsFeatures, "one-row-too-many": OneRowTooMany}


@breaks("method", "presets-resolve")
@dataclass
class OldPreset(StaticGaussiansConfig):
    presets: ClassVar = {"default": {}, "fast": {"there_is_no_such_key": 1}}


@breaks("callback", "takes-all-events")
class OldFigures(Callback):
    def on_evaluation(self, step, evaluation, control):
        assert evaluation.means["lpips"]


@breaks("callback", "changes-no-bits")
class ChangesTheModel(Callback):
    def on_start(self, run, control):
        self.model = run.model

    def on_tick(self, step, control):
        with torch.no_grad():
            next(iter(self.model.model.columns().values())).values.mul_(1.001)


@breaks("callback", "leaves-the-global-generator")
class Draws(Callback):
    def on_tick(self, step, control):
        torch.rand(())


@breaks("callback", "a-stop-works")
class NeedsAnEnd(Callback):
    def on_end(self, step, summary):
        assert summary["psnr"]
