"""Method spacetime: Li et al. 2024, "Spacetime Gaussian Feature Splatting".

Losses, the SH degree and the initialisation are those of method 3dgs; this method holds an instance
of it. The paper's guided sampling is strategy.guided.rounds=6, and off by default: from few random
points it gained 0.7 dB, from surface points nothing (see ``strategies.guided_sampling``). The paper
renders two views of one time per step, as sampler=same-time does; the default is one view, which
was 1.9 dB better on the built-in scene for the same number of views (2000, 240 x 180, seed 0).
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import torch

from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.refiner import Refiner
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.methods.moving.method import MovingMethod
from gsfw.methods.spacetime.adaptive_model import AdaptiveSpacetimeGaussians
from gsfw.methods.spacetime.decoder import FeatureDecoder
from gsfw.methods.spacetime.initialisation import at_rest, min_duration
from gsfw.methods.spacetime.model import SpacetimeGaussians
from gsfw.methods.spacetime.simplification import Simplification

if TYPE_CHECKING:
    from gsfw.methods.spacetime.config import SpacetimeConfig


class SpacetimeMethod(MovingMethod):
    """Static Gaussians, each with a path and a temporal centre."""

    def __init__(self, config: SpacetimeConfig) -> None:
        # The decoder adds view dependence, so base colours need no bands.
        canonical = config if config.colors == "sh" else replace(config, sh_degree=0)
        super().__init__(canonical, config)
        self.config = config
        self._model: SpacetimeGaussians | None = None

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> SpacetimeGaussians:
        """Build Gaussians at rest from a file's splats, from the scene's points, or at random."""
        config = self.config
        canonical = self.canonical.build_model(scene, operators, generator, initial)
        count = canonical.num_rows
        if initial is None:
            centers = self.start_times(scene, count, generator)
        else:
            centers = torch.rand(count, generator=generator)
        features = config.colors == "features"
        start = at_rest(
            canonical,
            centers,
            duration=config.init_duration,
            order=config.motion_order,
            spin=config.spin,
            features=features,
        )
        adaptive = config.motion == "adaptive"
        self._model = (AdaptiveSpacetimeGaussians if adaptive else SpacetimeGaussians)(
            canonical,
            start,
            config.optim.learning_rates(scene.extent),
            operators,
            min_duration=min_duration(scene),
            lifetime_reg=config.lifetime_reg,
            decoder=FeatureDecoder(generator) if features else None,
            still=self.still_rows(count, all_still=not self.starts_timed(scene, initial)),
        )
        return self._model

    def graph_key(self, step: int) -> Hashable | None:
        """The key that all moving methods share."""
        return self.shared_key(step)

    def refiners(self, scene: Scene, model: PrimitiveModel) -> tuple[Refiner, ...]:
        """The refiners of all moving methods, and simplification under motion=adaptive."""
        found = super().refiners(scene, model)
        if not isinstance(model, AdaptiveSpacetimeGaussians):
            return found
        return (*found, Simplification(self.config, model))

    def report(self) -> Mapping[str, Any]:
        """Number of rows with each temporal parameter, and of removals, with motion=adaptive."""
        if not isinstance(self._model, AdaptiveSpacetimeGaussians):
            return super().report()
        motion = self._model.census()
        part = 1 - motion["time_floats"] / max(motion["time_floats_full"], 1)
        left_out = f"{100 * part:.0f} % of the floats that paths, rotations and times would take"
        return {**super().report(), "motion": {**motion, "left_out": left_out}}
