"""Plan: turns the time that a run may take into its settings, by the speed of its own first steps.

The run is composed, takes a few steps that leave no trace (``trial``), and is composed anew with
the settings that were decided. Its schedules then have a length, and the timekeeper of the trainer
sees to it that the run walks through them in time, whatever becomes of the machine.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.errors import ConfigError
from gsfw.core.loop.held_back import LEAST_LEFT, HeldBack
from gsfw.core.loop.machine_clock import MachineClock
from gsfw.core.loop.remaining_time import RemainingTime
from gsfw.core.loop.timekeeper import Timekeeper
from gsfw.core.scene import Scene
from gsfw.planning.asked import Asked, without
from gsfw.planning.choices import DOWNSCALES, ENOUGH_UPDATES, chosen, downscale, limits
from gsfw.planning.length import enough_steps
from gsfw.planning.measurement import Measurement, glanced
from gsfw.planning.speed import ENDING, Speed
from gsfw.plugins.compose import Composition
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored
from gsfw.plugins.settings import PLANNED_BY, Layer, Settings, resolve

FIRST_LOOK = 0.5
"""Seconds of steps in the first look, by which image size and start are chosen."""
TRIAL_SHARE, SHORTEST_TRIAL, LONGEST_TRIAL = 0.02, 1.0, 10.0
"""Part of the time that the second look takes, at the chosen size and from the chosen start, and
its seconds at least and at most: other work on the machine comes and goes, and a longer look is a
better plan."""
EVALUATION_SHARE, MOST_EVALUATIONS = 0.02, 5
"""Part of the time that evaluations before the last one may take, and their number at most."""
HELD_BACK_SHARE, MOST_HELD_BACK = 0.1, 8
"""Part of the training views that a run with a goal holds back, and their number at most."""
MOST_HOPE = 1.25
"""Factor at most by which a machine that was busy in the trial is expected to be faster later."""
FEWEST_STEPS = 20
"""Steps of the shortest plan."""
RECENT = 0.1
"""Last part of the finished steps over which the timekeeper measures the speed."""


@dataclass(frozen=True)
class Plan:
    """A run that was planned, ready to start."""

    asked: Asked
    composition: Composition
    """The run with the settings that were decided."""
    timekeeper: Timekeeper
    speed: Speed
    decided: Mapping[str, Any]
    """The settings that were decided, by dotted key."""
    is_asked: bool
    """True if the user asked for it; false for the usual time of data of the user's own."""

    @property
    def settings(self) -> Settings:
        """All settings of the run."""
        return self.composition.settings


def make_plan(
    asked: Asked, layers: Sequence[Layer], registry: Registry, clock: MachineClock
) -> Plan:
    """Measure this machine on this data, and decide.

    Args:
        asked: what the run has to keep.
        layers: values that the user gave.
        registry: the installed parts.
        clock: counts from the start of the command.

    Raises:
        ConfigError: the time is too short for any training; names one that is not.
    """
    settings = resolve(registry, layers)
    is_asked = any(key in layer.values for layer in layers for key in PLANNED_BY)
    measurement = Measurement(registry, clock, open_data(settings))
    scene = measurement.data.scene
    start = chosen(settings, ENOUGH_UPDATES, scene)
    look = Layer("a first look", {key: start[key] for key in start if key == "init"})
    first = resolve(registry, [*layers, look])
    views = measurement.data.views(Split.TRAIN)
    held_back = _held_back(asked, views, settings) if asked.until else {}
    is_free = "downscale" not in settings.given
    if (smaller := glanced(first, measurement.data)) is not first:
        first = smaller
        measurement.resize(first)
    speed = measurement.run(first, FIRST_LOOK, asked, is_asked)
    given = settings.config.downscale
    size = _image_size(asked, speed, measurement.data) if is_free else given
    asked = _possible(asked, speed, size, is_free, is_asked)
    decided = _decisions(settings, scene, speed, asked, size)
    settings_of = partial(_planned, registry, layers, asked)
    planned = settings_of(enough_steps(decided, settings_of, views))
    if size != speed.downscale:
        measurement.resize(planned)
    seconds = max(TRIAL_SHARE * 60 * asked.minutes, SHORTEST_TRIAL)
    fitting = _fitting(asked, planned)
    speed = measurement.run(planned, min(seconds, LONGEST_TRIAL), asked, is_asked, fitting)
    asked = _possible(asked, speed, size, is_free, is_asked)
    decided = _decisions(settings, scene, speed, asked, size) | held_back
    return _made(asked, layers, measurement, speed, decided, is_asked)


def _made(
    asked: Asked,
    layers: Sequence[Layer],
    measurement: Measurement,
    speed: Speed,
    decided: Mapping[str, Any],
    is_asked: bool,
) -> Plan:
    """The plan of a run whose speed was measured at its own image size.

    Raises:
        ConfigError: the parts of the run do not fit its steps.
    """
    settings_of = partial(_planned, measurement.registry, layers, asked)
    decided = enough_steps(decided, settings_of, measurement.data.views(Split.TRAIN))
    planned = settings_of(decided)
    with _fitting(asked, planned):
        composition = measurement.composed(planned)
    keeper = timekeeper(composition, asked.minutes * 60, measurement.clock, speed.view)
    return Plan(asked, composition, keeper, speed, decided, is_asked)


def _possible(asked: Asked, speed: Speed, size: float, is_free: bool, is_asked: bool) -> Asked:
    """The conditions, with a usual time that is possible.

    Raises:
        ConfigError: the time is too short for any training; names one that is not.
    """
    if is_asked:
        _check_time(asked, speed, size, is_free)
        return asked
    return replace(asked, minutes=max(asked.minutes, speed.least_minutes(size)))


def _planned(
    registry: Registry, layers: Sequence[Layer], asked: Asked, decided: Mapping[str, Any]
) -> Settings:
    """The settings of the run with some decisions."""
    return resolve(registry, _with_decisions(layers, asked, decided))


def _image_size(asked: Asked, speed: Speed, data: DataManager) -> float:
    """The divisor of the images that leaves enough updates."""
    cameras = data.views(Split.TRAIN).cameras
    smallest = min(cameras, key=lambda camera: camera.width * camera.height)
    sides = (round(smallest.width * speed.downscale), round(smallest.height * speed.downscale))
    return downscale(sides, [speed.updates(asked.minutes * 60, other) for other in DOWNSCALES])


@contextmanager
def _fitting(asked: Asked, planned: Settings) -> Iterator[None]:
    """Compose a planned run inside.

    Raises:
        ConfigError: the parts do not fit the number of steps: they fitted another one.
    """
    try:
        yield
    except ConfigError as error:
        raise ConfigError(
            f"{asked} leaves {planned.config.steps} steps: {error.message}",
            "Give more minutes, smaller images (downscale=2), or steps=N without a time.",
        ) from None


def timekeeper(
    composition: Composition,
    limit: float,
    clock: MachineClock,
    view_seconds: float = 0.0,
    spent: float = 0.0,
    first_step: int = 0,
) -> Timekeeper:
    """The timekeeper of a run.

    Args:
        composition: of the run.
        limit: seconds from the start of the run to its end.
        clock: counts from the start of this process.
        view_seconds: seconds to render one view and to compare it, until that is measured.
        spent: seconds that earlier processes of this run took.
        first_step: 0, or the step from which the run goes on.
    """
    remaining = RemainingTime(composition.info(Path(), first_step), RECENT)
    remaining.evaluated(first_step, view_seconds, 1)
    return Timekeeper(remaining, limit, ENDING, clock, spent)


def resumed_timekeeper(restored: Restored, clock: MachineClock) -> Timekeeper | None:
    """The timekeeper of a run that goes on; ``None`` for runs that are not to end in a time.

    The time between the checkpoint and the end of the earlier process does not count.
    """
    minutes = restored.composition.settings.config.minutes
    if not minutes:
        return None
    walk = restored.state.get("walk", {})
    view_seconds, spent = walk.get("view_seconds", 0.0), walk.get("spent", 0.0)
    limit, first_step = minutes * 60, restored.step
    return timekeeper(restored.composition, limit, clock, view_seconds, spent, first_step)


def _check_time(asked: Asked, speed: Speed, size: float, is_free: bool) -> None:
    """Refuse a time in which nothing would be trained.

    Raises:
        ConfigError: names the time that is needed.
    """
    if speed.updates(asked.minutes * 60, size) >= FEWEST_STEPS:
        return
    least = speed.seconds(FEWEST_STEPS, size)
    busy = " (it seems to be busy with other work)" if speed.busy > 2 else ""
    advice = "" if is_free else ", or smaller images: leave out downscale, and the plan chooses it"
    raise ConfigError(
        f"minutes={asked.minutes:g}: that is {asked.minutes * 60:.0f} s, and loading, measuring "
        f"and the work after the last step take about {speed.around(size):.0f} s on this machine"
        f"{busy}.",
        f"Give minutes={math.ceil(least * 1.2 / 6) / 10:g} or more{advice}.",
    )


def _held_back(asked: Asked, views: Views, settings: Settings) -> dict[str, int]:
    """The number of training views that a run with a goal holds back, unless it is given.

    Raises:
        ConfigError: there are too few views, or none can be held back.
    """
    is_given, most = "held_back" in settings.given, len(views) // (1 + LEAST_LEFT)
    if most < 1 and not is_given:
        raise ConfigError(
            f"until={asked.until} is judged on training views that the run holds back, and "
            f"{len(views)} are too few: expected at least {1 + LEAST_LEFT}.",
            "Give minutes=M or steps=N instead.",
        )
    usual = min(max(round(HELD_BACK_SHARE * len(views)), 2), MOST_HELD_BACK, most)
    count = settings.config.held_back if is_given else usual
    if not HeldBack(views, count).views:
        raise ConfigError(
            f"until={asked.until}: no training view can be held back to measure it: each needs "
            "others of its time and size, and held_back above 0.",
            "Give a time instead: minutes=5.",
        )
    return {} if is_given else {"held_back": count}


def _decisions(
    settings: Settings, scene: Scene, speed: Speed, asked: Asked, size: float
) -> dict[str, Any]:
    """The settings of a run at a divisor of the images."""
    limit = asked.minutes * 60
    # A busy machine may get idle, and a schedule with steps to spare is walked through faster; one
    # with too few would have no room to grow.
    updates = speed.updates(limit, size) * min(speed.busy, MOST_HOPE)
    if asked.until:  # The time is a bound: a run that may end early needs no longer schedule.
        updates = min(updates, settings.config.steps)
    steps = settings.config.steps if "steps" in settings.given else _rounded(updates)
    evaluation = speed.evaluation(size)
    evaluations = min(int(EVALUATION_SHARE * limit / evaluation), MOST_EVALUATIONS)
    found = {
        **({} if "steps" in settings.given else {"steps": steps}),
        **chosen(settings, updates, scene),
        **limits(settings, updates, scene, speed.view_pixels(size), speed.gaussians),
    }
    if size != 1 and "downscale" not in settings.given:
        found["downscale"] = size
    if "eval_every" not in settings.given:
        found["eval_every"] = math.ceil(steps / (evaluations + 1)) if evaluations else 0
    return found


def _rounded(updates: float) -> int:
    """A number of steps with two digits, which people can compare."""
    digits = 10 ** max(math.floor(math.log10(updates)) - 1, 0)
    return int(updates // digits * digits)


def _with_decisions(
    layers: Sequence[Layer], asked: Asked, decided: Mapping[str, Any]
) -> list[Layer]:
    """The values of the user and the decisions.

    A file of this run repeats the decisions: what was asked for is written there, and not given.
    """
    wish = {"minutes": asked.minutes, "until": asked.until}
    source = f"planned for {asked}"
    names = frozenset(decided)
    plan = Layer(source, {**decided, **wish}, given=names, planned=names)
    return [*(without(layer, PLANNED_BY) for layer in layers), plan]
