"""Trial: small runs on the built-in scene, and parts built from their configurations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from gsfw.core.callback import Callback, Control, StepReport
from gsfw.core.config import MethodConfig
from gsfw.core.datamanager import DataManager, DataRequest, Split
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.core.ranges import check_ranges
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.config_file import write_config
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import restore
from gsfw.plugins.settings import Layer, Settings, resolve
from gsfw.testing.promise import require
from gsfw.testing.subject import Subject

STEPS = 20
"""Length of a trial, unless a check has its own."""

SCENE: Mapping[str, object] = {
    "datamanager": "synthetic",
    "datamanager.views": 6,
    "datamanager.eval_views": 1,
    "datamanager.width": 24,
    "datamanager.height": 18,
    "datamanager.points": 80,
}
"""The built-in scene at a size that trains in a fraction of a second."""

MOTION: Mapping[str, object] = {"datamanager.moving": True, "datamanager.times": 3}
"""Settings that make it move."""

RUN: Mapping[str, object] = {
    "device": "cpu",
    "steps": STEPS,
    "log_every": 1,
    "eval_every": 0,
    "checkpoint_every": 0,
    "report": False,
}
"""Settings of a trial."""

Changes = Mapping[str, object]
"""Settings by dotted key."""


@dataclass
class Losses(Callback):
    """Records the loss and the number of rows of each step."""

    losses: list[float] = field(default_factory=list)
    rows: list[int] = field(default_factory=list)

    def on_step(self, report: StepReport, control: Control) -> None:
        """Record a step."""
        self.losses.append(report.loss)
        self.rows.append(report.num_gaussians)


@dataclass
class Trial:
    """A small run of some settings."""

    registry: Registry
    values: Changes
    """All given settings, by dotted key."""
    folder: Path

    def settings(self) -> Settings:
        """All settings of the run.

        Raises:
            ConfigError: a setting is unknown or wrong.
        """
        return resolve(self.registry, [Layer("the settings of the check", self.values)])

    def data(self) -> DataManager:
        """The data of the run."""
        return open_data(self.settings())

    def composition(self, data: DataManager | None = None) -> Composition:
        """Build the run.

        Args:
            data: replaces the data of the settings; ``None`` for these.

        Raises:
            ConfigError: the parts do not fit together.
        """
        return compose(self.settings(), self.registry, data=data)

    def trainer(
        self, callbacks: Sequence[Callback] = (), data: DataManager | None = None
    ) -> Trainer:
        """A trainer before its first step; ``data`` as for ``composition``.

        Raises:
            ConfigError: the parts do not fit together.
        """
        composition, folder = self.composition(data), RunFolder(self.folder)
        folder.path.mkdir(parents=True, exist_ok=True)
        folder.config.write_text(write_config(composition.settings, ["check"]), encoding="utf-8")
        return composition.trainer(folder, callbacks)

    def resumed(self, step: int, callbacks: Sequence[Callback] = ()) -> Trainer:
        """A trainer that continues from the checkpoint after ``step`` steps."""
        folder = RunFolder(self.folder)
        restored = restore(folder, self.registry, folder.checkpoint(step))
        trainer = restored.composition.trainer(restored.folder, callbacks, restored.step)
        trainer.load_state_dict(restored.state)
        return trainer

    def state(self, step: int) -> dict[str, Any]:
        """The checkpoint after some steps, without the time that they took."""
        state = read_checkpoint(RunFolder(self.folder).checkpoint(step))
        del state["train_seconds"]
        return state


def trial(subject: Subject, name: str, changes: Changes, method: str = "3dgs") -> Trial:
    """A small run for a part, in a folder of this name; ``changes`` win over all other settings.

    It has no strategy, unless ``changes`` or the settings of the subject choose one.
    """
    given = dict(item.split("=", 1) for item in subject.settings)
    data = {"data": str(subject.data)} if subject.data else SCENE
    values = {"method": method, "strategy": "none", **data, **RUN, **given, **changes}
    values |= {f"callbacks.{key}.enabled": False for key in watchers(subject.registry)}
    return Trial(subject.registry, values, subject.workspace / name)


def watchers(registry: Registry) -> tuple[str, ...]:
    """Names of all callbacks, as in keys; trials switch them off."""
    from gsfw.plugins.loading import callback_configs

    return tuple(vars(callback_configs(registry)))


def difference(first: object, second: object) -> str:
    """The first place where two nested states differ in a bit; empty if they are equal."""
    one, other = dict(_flat(first)), dict(_flat(second))
    if one.keys() != other.keys():
        return f"only one of them has {min(one.keys() ^ other.keys())}"
    return next((f"{key} differs" for key in one if not _same(one[key], other[key])), "")


def require_equal_resume(run: Trial, at: int, steps: int, advice: str) -> None:
    """Require a finished run, resumed at an earlier step, to end with the same bits.

    Raises:
        BrokenPromise: it ends with others; names the first.
    """
    whole = run.state(steps)
    run.resumed(at).fit()
    found = difference(whole, run.state(steps))
    require(not found, f"resumed at step {at}, {found}.", advice)


def require_own_generator(run_of: Callable[[str], Trial], steps: int, advice: str) -> None:
    """Require runs to have the same bits under another seed of torch's global generator.

    Args:
        run_of: the run in a folder of this name.
        steps: of the run.
        advice: the remedy.

    Raises:
        BrokenPromise: the bits differ; names the first place.
    """
    states = []
    with torch.random.fork_rng(devices=()):
        for seed in (1, 2):
            torch.manual_seed(seed)
            run = run_of(f"seeded-{seed}")
            run.trainer().fit()
            states.append(run.state(steps))
    found = difference(*states)
    require(not found, f"under another torch.manual_seed, {found}.", advice)


def _flat(state: object, where: str = "") -> Iterator[tuple[str, object]]:
    """Tensors and plain values of a nested state by place."""
    if isinstance(state, Mapping):
        for key, value in state.items():
            yield from _flat(value, f"{where}.{key}" if where else str(key))
    elif isinstance(state, list | tuple):
        for index, value in enumerate(state):
            yield from _flat(value, f"{where}[{index}]")
    else:
        yield where, state


def _same(first: object, second: object) -> bool:
    if isinstance(first, Tensor) and isinstance(second, Tensor):
        same_form = (first.dtype, first.shape) == (second.dtype, second.shape)
        return same_form and torch.equal(_bytes(first), _bytes(second))
    return type(first) is type(second) and first == second


def _bytes(tensor: Tensor) -> Tensor:
    """The bytes of a tensor: those of NaN equal themselves, and those of 0 are not those of -0."""
    return tensor.detach().cpu().contiguous().flatten().view(torch.uint8)


@lru_cache(maxsize=4)
def tiny_data(moving: bool) -> DataManager:
    """The built-in scene at its smallest, static or moving; images are cast when asked for."""
    config = SyntheticConfig(
        views=6, eval_views=1, width=24, height=18, points=80, moving=moving, times=3
    )
    return config.build(DataRequest(None))


class Builder:
    """Builds the part of a configuration as a run would."""

    def __init__(self, subject: Subject) -> None:
        self._subject = subject

    def build(self, config: Any) -> object:  # noqa: ANN401 - any configuration
        """Check the ranges of a configuration, and build its part.

        Raises:
            UserError: a setting is out of range, or the part cannot be built.
        """
        check_ranges(config)
        slot, data = self._subject.slot, tiny_data(moving=True)
        if slot == "method":
            assert isinstance(config, MethodConfig)
            config.check()
            return config.build()
        if slot == "strategy":
            return config.refiners(data.scene)
        if slot == "exporter":
            return config  # Its options are its own fields.
        if slot == "callback":
            callback = config.build()
            callback.close()
            return callback
        arguments: dict[str, tuple[Any, ...]] = {
            "sampler": (data.views(Split.TRAIN), 0, STEPS),
            "rasterizer": (torch.device("cpu"),),
            "datamanager": (request_of(self._subject),),
        }
        return config.build(*arguments[slot])


def request_of(subject: Subject, **changes: Any) -> DataRequest:  # noqa: ANN401 - fields
    """The request for the data of a subject."""
    return replace(DataRequest(subject.data, eval_every_nth=3), **changes)
