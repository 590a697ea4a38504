"""MovingMethod: what every method for scenes that move takes over from method 3dgs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.method import Method
from gsfw.core.model import PrimitiveModel
from gsfw.core.refiner import Refiner
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.methods.gaussians3d.config import GaussiansConfig
from gsfw.methods.gaussians3d.initialisation import usable_rows
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.methods.moving.config import MovingConfig
from gsfw.methods.moving.gaussians import MovingGaussians
from gsfw.methods.moving.scene import as_static, check_times
from gsfw.methods.moving.settling import Settling
from gsfw.methods.moving.still_rows import StillRows


class MovingMethod(Method):
    """Losses, the SH degree and where Gaussians start are those of method 3dgs.

    It holds an instance of that method, ``_static``, for the canonical Gaussians. How they change
    with time is up to each method.
    """

    name: ClassVar[str]
    """As ``method=NAME`` has it."""

    def __init__(self, canonical: GaussiansConfig, settling: MovingConfig | None = None) -> None:
        """Take the settings of the canonical Gaussians, and of which of them stand still.

        Without the latter none do, and the model need not be one of ``MovingGaussians``.
        """
        self._static = StaticGaussiansMethod(canonical)
        self._settling = settling

    def check_scene(self, scene: Scene) -> None:
        """Refuse captures of a single time, and init=points where there are none.

        Raises:
            ConfigError: saying what to do instead.
        """
        check_times(scene, self.name)
        self._static.check_scene(as_static(scene))

    def notes(self, scene: Scene) -> tuple[str, ...]:
        """How the start differs from what one may expect."""
        return self._static.notes(as_static(scene))

    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """L1 and SSIM, by the weight that SSIM is given."""
        return self._static.losses(context)

    def still_rows(self, scene: Scene, count: int, initial: Splats | None) -> StillRows | None:
        """Which rows stand still: all, until something says that they move; ``None``: none can.

        Points that know when they were seen begin as things that come and go, where a model's rows
        have a time of their own.
        """
        if self._settling is None or self._settling.static == "none":
            return None
        timed = initial is None and self._point_times(scene) is not None
        return StillRows(count, all_still=not timed)

    def start_times(
        self, scene: Scene, count: int, generator: torch.Generator
    ) -> Float[Tensor, " n"]:
        """When the points that a model starts from were seen; else spread over the sequence."""
        times = self._point_times(scene)
        if times is not None and len(times) == count:
            return times
        return torch.rand(count, generator=generator)

    def _point_times(self, scene: Scene) -> Float[Tensor, " p"] | None:
        """When each point that a model starts from was seen; ``None``: not known, or no points."""
        if scene.point_times is None:
            return None
        rows = usable_rows(scene)[0]
        return None if self._static.starts_at_random(rows) else scene.point_times[rows]

    def prepare(
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Let the SH degree follow the step."""
        assert isinstance(model, MovingGaussians)
        self._static.prepare(step, model.canonical, optimizer, time)

    def refiners(self, scene: Scene, model: PrimitiveModel) -> tuple[Refiner, ...]:
        """Adaptive bands under sh=adaptive, settling under static=auto."""
        if not isinstance(model, MovingGaussians):
            return ()  # Tracked rows are what they are from the first time on.
        bands, config = self._static.refiners(scene, model.canonical), self._settling
        if config is None or model.still is None:
            return bands
        return (*bands, Settling(config, model))

    def state_dict(self) -> dict[str, Any]:
        """That of method 3dgs."""
        return self._static.state_dict()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on with it."""
        self._static.load_state_dict(state)
