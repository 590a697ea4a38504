"""Settings of the built-in scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.core.config import DataManagerConfig, Detection
from gsfw.core.errors import ConfigError
from gsfw.core.ranges import number

if TYPE_CHECKING:
    from gsfw.core.datamanager import DataManager, DataRequest


@dataclass
class SyntheticConfig(DataManagerConfig):
    """The built-in scene: a small still life, ray-cast view by view as they are needed."""

    recommended: ClassVar[Mapping[str, Any]] = {
        "steps": 3000,
        # Small images make large gradients, and few steps leave no time to recover from resets.
        "strategy.grow_gradient": 4e-4,
        "strategy.max_gaussians": 40_000,
        "strategy.reset_every": 0,
    }
    still: ClassVar[Mapping[str, Any]] = {
        "steps": 1000,
        "eval_every": 500,
        "strategy.grow_gradient": 1.5e-4,
    }
    """Other recommendations for the scene without motion: 40 dB come soon."""

    acts_with: ClassVar[Mapping[str, str]] = {
        "times": "moving=true",
    }

    views: int = number(60, at_least=2)
    """Training views, on a dome around the scene."""
    eval_views: int = number(8, at_least=0)
    """Held-out views, elsewhere on the dome."""
    width: int = number(480, at_least=1)
    """Width of an image in pixels, before downscaling."""
    height: int = number(360, at_least=1)
    """Height of an image in pixels, before downscaling."""
    points: int = number(10_000, at_least=0)
    """Surface points to start from, each seen by some training view."""
    moving: bool = False
    """True if solids translate, rotate, deform, appear and vanish, and views carry a time."""
    times: int = number(10, at_least=2)
    """Distinct times of the moving scene, shared evenly among the training views."""
    seed: int = 0
    """Draws textures, cameras and points; independent of the run's seed."""

    def recommendations(self) -> Mapping[str, Any]:
        """The settings that the scene is meant for."""
        return self.recommended if self.moving else {**self.recommended, **self.still}

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """Nothing on disk is the built-in scene."""
        return Detection(recognised=False, looked_for="")

    def build(self, request: DataRequest) -> DataManager:
        """Place the cameras and cast the points to start from; images are cast when asked for.

        Raises:
            ConfigError: the settings contradict each other, or would take more memory than
                ``cache_mb``.
        """
        self._check(request)
        from gsfw.datamanagers.synthetic.data import SyntheticData

        return SyntheticData(self, request)

    def _check(self, request: DataRequest) -> None:
        if request.path is not None:
            raise ConfigError(
                f"datamanager=synthetic is built in and reads no data, but data={request.path}.",
                "Leave out data, or leave out datamanager to have the format recognised.",
            )
        if self.moving and self.views < self.times:
            raise ConfigError(
                f"datamanager.views={self.views} cannot show datamanager.times={self.times}.",
                "Each time needs a view of its own: ask for more views, or for fewer times.",
            )
        pixels = self.width * self.height / request.downscale**2
        megabytes = math.ceil((self.views + self.eval_views) * pixels * 4 / 1e6)
        if megabytes > request.cache_megabytes:
            raise ConfigError(
                f"the built-in scene would take {megabytes} MB, "
                f"but cache_mb={request.cache_megabytes}.",
                f"Give cache_mb={megabytes} or more, or ask for fewer or smaller images.",
            )
