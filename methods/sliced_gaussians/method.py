"""Method 4d-rotor: Duan et al. 2024, "4D-Rotor Gaussian Splatting".

Losses, the SH degree and where Gaussians start are those of method 3dgs, of which this one holds
an instance. Density control does not look at the gradient of temporal centres, as the paper's does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.context import StepContext
from gsfw.core.method import Method
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.optimizer import Optimizer
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.methods.moving_scene import as_static, check_times
from gsfw.methods.sliced_gaussians.model import MAX_DURATION, Regularization, SlicedGaussians
from gsfw.methods.sliced_gaussians.rotation import Rotation
from gsfw.methods.sliced_gaussians.rotor import Rotor
from gsfw.methods.sliced_gaussians.two_quaternions import TwoQuaternions
from gsfw.methods.static_gaussians.initialisation import usable_rows
from gsfw.methods.static_gaussians.method import StaticGaussiansMethod

if TYPE_CHECKING:
    from gsfw.methods.sliced_gaussians.config import SlicedGaussiansConfig

ROTATIONS: Mapping[str, type[Rotation]] = {"rotor": Rotor, "two-quaternions": TwoQuaternions}


class SlicedGaussiansMethod(Method):
    """Static Gaussians at first, each with a time at which it is there."""

    def __init__(self, config: SlicedGaussiansConfig) -> None:
        self._config = config
        self._static = StaticGaussiansMethod(config)

    def check_scene(self, scene: Scene) -> None:
        """Refuse captures of a single time, and init=points where there are none.

        Raises:
            ConfigError: saying what to do instead.
        """
        check_times(scene, "4d-rotor")
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
    ) -> SlicedGaussians:
        """Gaussians at rest at the splats of a file, at the scene's points, or at random."""
        config = self._config
        canonical = self._static.build_model(scene, operators, generator, initial)
        if initial is None:
            centers = self._centers(scene, canonical.num_rows, generator)
        else:
            centers = torch.full((canonical.num_rows,), 0.5)
        return SlicedGaussians(
            canonical,
            centers,
            config.optim.learning_rates(scene.extent),
            ROTATIONS[config.rotation](),
            # The splats of a file belong to every time.
            duration=config.init_duration if initial is None else MAX_DURATION,
            min_duration=min_duration(scene),
            regularization=Regularization(
                config.entropy_reg, config.velocity_reg, config.neighbors_every
            ),
        )

    def _centers(self, scene: Scene, count: int, generator: torch.Generator) -> Float[Tensor, " n"]:
        """When the points were seen, where that is known; else spread over the sequence."""
        if scene.point_times is not None and not self._static.starts_at_random(scene.points):
            centers = scene.point_times[usable_rows(scene)[0]]
            if len(centers) == count:
                return centers
        return torch.rand(count, generator=generator)

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
        assert isinstance(model, SlicedGaussians)
        self._static.prepare(step, model.canonical, optimizer, time)


def min_duration(scene: Scene) -> float:
    """Shortest standard deviation in time, in sequences: half of the time between two pictures."""
    return 0.5 / max(scene.num_times - 1, 1)
