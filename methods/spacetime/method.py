"""Method spacetime: Li et al. 2024, "Spacetime Gaussian Feature Splatting".

Losses, the SH degree and where Gaussians start are those of method 3dgs, of which this one holds
an instance. Guided sampling of new Gaussians where the error is large is not done. The paper draws
two views of one time per step, which sampler=same-time does; the default is one view, as that was
1.9 dB better on the built-in scene for the same number of views (2000, 240 x 180, seed 0).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.method import Method
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.optimizer import Optimizer
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.methods.moving_scene import as_static, check_times
from gsfw.methods.spacetime.decoder import FeatureDecoder
from gsfw.methods.spacetime.initialisation import (
    at_rest,
    min_duration,
    point_centers,
    random_centers,
)
from gsfw.methods.spacetime.model import SpacetimeGaussians
from gsfw.methods.static_gaussians.method import StaticGaussiansMethod

if TYPE_CHECKING:
    from gsfw.methods.spacetime.config import SpacetimeConfig


class SpacetimeMethod(Method):
    """Static Gaussians, each with a path and a time of its own."""

    def __init__(self, config: SpacetimeConfig) -> None:
        self._config = config
        # The decoder adds what depends on the direction, so that base colours need no bands.
        canonical = config if config.colors == "sh" else replace(config, sh_degree=0)
        self._static = StaticGaussiansMethod(canonical)

    def check_scene(self, scene: Scene) -> None:
        """Refuse captures of a single time, and init=points where there are none.

        Raises:
            ConfigError: saying what to do instead.
        """
        check_times(scene, "spacetime")
        self._static.check_scene(as_static(scene))

    def notes(self, scene: Scene) -> tuple[str, ...]:
        """How the start differs from what one may expect."""
        return self._static.notes(as_static(scene))

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> SpacetimeGaussians:
        """Gaussians at rest at the splats of a file, at the scene's points, or at random."""
        config = self._config
        canonical = self._static.build_model(scene, operators, generator, initial)
        centers = None
        if initial is None and not self._static.starts_at_random(scene.points):
            centers = point_centers(scene)
        if centers is None or len(centers) != canonical.num_rows:
            centers = random_centers(canonical.num_rows, generator)
        features = config.colors == "features"
        start = at_rest(
            canonical,
            centers,
            duration=config.init_duration,
            order=config.motion_order,
            spin=config.spin,
            features=features,
        )
        return SpacetimeGaussians(
            canonical,
            start,
            config.optim.learning_rates(scene.extent),
            min_duration=min_duration(scene),
            lifetime_reg=config.lifetime_reg,
            decoder=FeatureDecoder(generator) if features else None,
        )

    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """L1 and SSIM, as method 3dgs has them."""
        return self._static.losses(context)

    def state_dict(self) -> dict[str, Any]:
        """That of method 3dgs."""
        return self._static.state_dict()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on with it."""
        self._static.load_state_dict(state)

    def prepare(
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Let the SH degree follow the step."""
        assert isinstance(model, SpacetimeGaussians)
        self._static.prepare(step, model.canonical, optimizer, time)
