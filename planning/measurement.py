"""Measurement: the speed of a run on this machine, from steps of a composition that is dropped."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from gsfw.core.cores import cores
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.machine_clock import MachineClock
from gsfw.core.loop.remaining_time import RemainingTime
from gsfw.core.progress import stage
from gsfw.planning.asked import Asked
from gsfw.planning.speed import Speed
from gsfw.planning.trial import seconds_to_load, try_steps
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import Registry
from gsfw.plugins.settings import Settings
from gsfw.plugins.start import FoundPoints, find_points

TRIAL_PIXELS = 500_000
"""Pixels of the images of a first look at most: larger ones take seconds a step, and a plan for a
short time has no use for them."""
MOST_SHARE = 0.25
"""Part of the time of a run after which a look ends with its next step, the second at least."""
ENOUGH = 4
"""Times as long as what comes before the first step is proposed for a run that was too short."""
DECODERS = 4
"""Images that are decoded at the same time, at most."""
MATURITY = 1.15
"""Mean time of a step over that of a first step with as many Gaussians and pixels: splats become
wider and opaque, and degrees of harmonics come in. Measured: chair 0.65, plush 1.1 and fox 1.4 from
dense points, fox 1.8 from its 12,000 points; it is a guess, which the pace corrects."""


@dataclass
class Measurement:
    """Measures one plan's runs, which share their data and the points that are found in it."""

    registry: Registry
    clock: MachineClock
    data: DataManager
    """The capture, at the image size of the latest run."""
    found: FoundPoints | None = None
    """Points found in its images; ``None`` before the first run."""

    def run(
        self,
        settings: Settings,
        seconds: float,
        asked: Asked,
        is_asked: bool,
        fitting: AbstractContextManager[None] | None = None,
    ) -> Speed:
        """The speed of a run with the image size of ``data``.

        Args:
            settings: of the run.
            seconds: of the steps that are measured; fewer steps if these take ``MOST_SHARE`` of
                the time of the run.
            asked: the time of the run.
            is_asked: whether the user gave that time.
            fitting: the context in which the parts are composed.

        Raises:
            ConfigError: the time that the user gave has passed before any step.
        """
        self.found = find_points(settings, self.registry, self.data, self.found)
        began, work = self.clock.seconds(), self.clock.work()
        with fitting or nullcontext():
            composition = self.composed(settings)
        remaining = RemainingTime(composition.info(Path()))
        built = self.clock.seconds() - began
        limit = 60 * asked.minutes
        if is_asked and self.clock.seconds() > limit:
            raise _too_short(asked, self.clock.seconds())
        with stage("measuring how long steps take here"):
            load = seconds_to_load(composition) / min(DECODERS, cores())
            trial = try_steps(composition, seconds, MOST_SHARE * limit)
        held_out, training = (len(self.data.views(split)) for split in (Split.EVAL, Split.TRAIN))
        return Speed(
            downscale=settings.config.downscale,
            pixels=self.data.views(Split.TRAIN).pixels,
            gaussians=trial.rows,
            state_bytes=trial.state_bytes,
            before=self.clock.seconds() + built,
            step=trial.step,
            view=trial.view,
            load=load,
            views=held_out + training,
            held_out=held_out,
            mean_cost=MATURITY * remaining.mean_cost(trial.rows),
            busy=self.clock.work().slowdown(work),
        )

    def composed(self, settings: Settings) -> Composition:
        """The run, with the data and the points that are known."""
        return compose(settings, self.registry, data=self.data, found=self.found)

    def resize(self, settings: Settings) -> None:
        """Open the data again, at the image size of the settings."""
        self.data.close()
        self.data = open_data(settings)


def _too_short(asked: Asked, passed: float) -> ConfigError:
    """The error about a time that has passed before any step."""
    return ConfigError(
        f"minutes={asked.minutes:g}: that is {60 * asked.minutes:.0f} s, and reading the data and "
        f"building the model have taken {passed:.0f} s on this machine.",
        f"Give minutes={math.ceil(ENOUGH * passed / 6) / 10:g} or more.",
    )


def glanced(settings: Settings, data: DataManager) -> Settings:
    """The settings of a first look: with images of ``TRIAL_PIXELS`` at most."""
    pixels, config = data.views(Split.TRAIN).pixels, settings.config
    if pixels <= TRIAL_PIXELS:
        return settings
    divisor = math.ceil((pixels / TRIAL_PIXELS) ** 0.5)
    return replace(settings, config=replace(config, downscale=config.downscale * divisor))
