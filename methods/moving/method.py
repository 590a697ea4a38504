"""MovingMethod: the parts of method 3dgs in every method for moving scenes."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.datamanager import Views
from gsfw.core.errors import ConfigError
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.loop.recordable import graph_key
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
    """Losses, the SH degree and the initialisation are those of method 3dgs.

    A derived method has ``build_model`` alone: it makes the canonical Gaussians with
    ``self.canonical.build_model``, and returns a model of them with their changes with time.
    """

    canonical_method: ClassVar[type[StaticGaussiansMethod]] = StaticGaussiansMethod
    """Class that makes the canonical Gaussians; derive from it to give them more columns."""

    def __init__(self, canonical: GaussiansConfig, settling: MovingConfig | None = None) -> None:
        """Store the settings of the canonical Gaussians, and of static rows.

        Args:
            canonical: settings of the canonical Gaussians.
            settling: settings of static rows; ``None``: no row can be static. The model need not be
                ``MovingGaussians`` then, if ``prepare`` is overridden.

        Raises:
            ConfigError: static=auto, and no row can be static.
        """
        if settling is None and isinstance(canonical, MovingConfig) and canonical.static != "none":
            raise ConfigError(
                "static=auto: all Gaussians of this method move, none can be static.",
                "Leave static out.",
            )
        self.canonical = self.canonical_method(canonical)
        """The method of the canonical Gaussians, of the class ``canonical_method``."""
        self._settling = settling
        self._prepared: MovingGaussians | None = None
        """The model of the current step; ``None`` before the first."""

    def check_scene(self, scene: Scene) -> None:
        """Refuse captures of a single time, and init=points without points.

        Raises:
            ConfigError: names the remedy.
        """
        check_times(scene, self.registered_as)
        self.canonical.check_scene(as_static(scene))

    def notes(self, scene: Scene) -> tuple[str, ...]:
        """Notes on the initialisation."""
        return self.canonical.notes(as_static(scene))

    @torch.no_grad()
    def begin(self, scene: Scene, views: Views, model: PrimitiveModel) -> None:
        """Make Gaussians of the sky, the last ones of a new model, present at all times."""
        count = 0 if scene.sky is None else len(scene.sky)
        if count == 0 or not isinstance(model, MovingGaussians):
            return
        device = model.canonical.means.values.device
        rows = torch.arange(model.num_rows - count, model.num_rows, device=device)
        if model.still is None or not bool(model.still.mask()[rows].any()):
            model.begin_(rows, torch.full((count,), 0.5, device=device))

    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """L1 and SSIM, weighted by ssim_weight."""
        return self.canonical.losses(context)

    def still_rows(self, count: int, *, all_still: bool = True) -> StillRows | None:
        """Mask of the initially static rows; ``None`` if no row can be static (static=none).

        Args:
            count: number of rows.
            all_still: true if all rows start static, false if all start moving.
        """
        if self._settling is None or self._settling.static == "none":
            return None
        return StillRows(count, all_still=all_still)

    def starts_timed(self, scene: Scene, initial: Splats | None) -> bool:
        """True if the initial points have capture times: temporary rows start moving there."""
        return initial is None and self._point_times(scene) is not None

    def start_times(
        self, scene: Scene, count: int, generator: torch.Generator
    ) -> Float[Tensor, " n"]:
        """Capture times of the initial points; else spread over the sequence."""
        times = self._point_times(scene)
        if times is not None and len(times) == count:
            return times
        return torch.rand(count, generator=generator)

    def _point_times(self, scene: Scene) -> Float[Tensor, " p"] | None:
        """Capture time of each initial point; ``None`` if unknown, or without points.

        Those of the sky are in the middle of the sequence.
        """
        if scene.point_times is None:
            return None
        rows = usable_rows(scene)[0]
        if self.canonical.starts_at_random(rows):
            return None
        sky = torch.full((0 if scene.sky is None else len(scene.sky),), 0.5)
        return torch.cat([scene.point_times[rows], sky])

    def prepare(
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Set the SH degree of the step."""
        assert isinstance(model, MovingGaussians)
        self._prepared = model
        self.canonical.prepare(step, model.canonical, optimizer, time)

    def shared_key(self, step: int) -> Hashable | None:
        """The part of a ``graph_key`` that all methods have: losses, SH degree, rows that change.

        ``None`` if steps cannot be recorded because of them, or select the visible rows.
        """
        own, model = graph_key(self.canonical, step), self._prepared
        if own is None or model is None or model.selects:
            return None
        return own, model.rows_version()

    def refiners(self, scene: Scene, model: PrimitiveModel) -> tuple[Refiner, ...]:
        """Adaptive bands and penalties of method 3dgs, and settling under static=auto."""
        if not isinstance(model, MovingGaussians):
            # Tracked rows do not change their kind after the first time.
            return self.canonical.penalties()
        bands, config = self.canonical.refiners(scene, model.canonical), self._settling
        if config is None or model.still is None:
            return bands
        return (*bands, Settling(config, model))

    def state_dict(self) -> dict[str, Any]:
        """The state of method 3dgs."""
        return self.canonical.state_dict()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        self.canonical.load_state_dict(state)
