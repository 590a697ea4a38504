"""Method 4d-rotor: Duan et al. 2024, "4D-Rotor Gaussian Splatting".

Losses, the SH degree and the initialisation are those of method 3dgs; this method holds an instance
of it. Density control uses the gradient of temporal centres too, as in the paper.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING

import torch

from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.methods.moving.method import MovingMethod
from gsfw.methods.rotor4d.model import MAX_DURATION, SlicedGaussians
from gsfw.methods.rotor4d.regularization import Regularization
from gsfw.methods.rotor4d.rotation import Rotation
from gsfw.methods.rotor4d.rotor import Rotor
from gsfw.methods.rotor4d.two_quaternions import TwoQuaternions

if TYPE_CHECKING:
    from gsfw.methods.rotor4d.config import SlicedGaussiansConfig

ROTATIONS: Mapping[str, type[Rotation]] = {"rotor": Rotor, "two-quaternions": TwoQuaternions}


class SlicedGaussiansMethod(MovingMethod):
    """Static Gaussians at first, each with a temporal centre."""

    def __init__(self, config: SlicedGaussiansConfig) -> None:
        super().__init__(config, config)
        self.config = config
        self._extent = 1.0

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> SlicedGaussians:
        """Build Gaussians at rest from a file's splats, from the scene's points, or at random."""
        config = self.config
        self._extent = scene.extent
        canonical = self.canonical.build_model(scene, operators, generator, initial)
        if initial is None:
            centers = self.start_times(scene, canonical.num_rows, generator)
        else:
            centers = torch.full((canonical.num_rows,), 0.5)
        return SlicedGaussians(
            canonical,
            centers,
            config.optim.learning_rates(scene.extent),
            ROTATIONS[config.rotation](),
            operators,
            # The splats of a file belong to every time.
            duration=config.init_duration if initial is None else MAX_DURATION,
            min_duration=min_duration(scene),
            regularization=Regularization(
                config.entropy_reg, config.velocity_reg, config.neighbors_every
            ),
            still=self.still_rows(
                canonical.num_rows, all_still=not self.starts_timed(scene, initial)
            ),
        )

    def prepare(
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Set the SH degree of the step, and search for neighbours if it is time for it."""
        assert isinstance(model, SlicedGaussians)
        super().prepare(step, model, optimizer, time)
        model.refresh_neighbors_(step, self._extent)

    def graph_key(self, step: int) -> Hashable | None:
        """The key that all moving methods share."""
        return self.shared_key(step)


def min_duration(scene: Scene) -> float:
    """Shortest standard deviation in time, in sequences: half of the time between two images."""
    return 0.5 / max(scene.num_times - 1, 1)
