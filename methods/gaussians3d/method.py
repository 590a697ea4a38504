"""Method 3dgs: Kerbl et al. 2023, "3D Gaussian Splatting for Real-Time Radiance Field Rendering".

Density control (section 5.2) is a strategy of its own. Differences: the initial size is the mean
distance to three neighbours, as in the paper (the released code has the root mean square), and
points that coincide or lie at a camera are skipped.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any, ClassVar

import torch
from torch import Tensor

from gsfw.core.column import Column
from gsfw.core.config import AUTO
from gsfw.core.context import StepContext
from gsfw.core.errors import ConfigError
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.maths.focus import object_place
from gsfw.core.maths.ssim import masked_mean
from gsfw.core.method import Method
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.random_start import random_count
from gsfw.core.refiner import Refiner
from gsfw.core.scene import Scene
from gsfw.core.splats import Sh, Splats
from gsfw.methods.gaussians3d.adaptive_bands import AdaptiveBands
from gsfw.methods.gaussians3d.config import GaussiansConfig, StaticGaussiansConfig
from gsfw.methods.gaussians3d.initialisation import (
    degrees_of,
    from_points,
    from_splats,
    random_points,
    usable_points,
    with_sky,
)
from gsfw.methods.gaussians3d.model import GaussianParameters, StaticGaussians
from gsfw.methods.gaussians3d.opacity_penalty import OpacityPenalty

RANDOM_COST = (
    "This costs quality (built-in scene, 2000 steps and splats: 0.6 dB with strategy=adc, 3.7 dB "
    "with mcmc) and leaves floaters where few views look; init=dense starts from surfaces that it "
    "finds in the images."
)
"""Measured on 12 views of 64 x 48 with points=400, against random_points=2000, seed 42."""


OWN_DEGREES = -1
"""Stands for the degree of all splats where each has its own."""


class StaticGaussiansMethod(Method):
    """L1 and SSIM, a growing SH degree, and Gaussians that do not change with time.

    To extend it, derive from it: name another ``model_class``, add ``extra_columns``, override
    ``losses``. The config's ``build`` makes the derived method.
    """

    model_class: ClassVar[type[StaticGaussians]] = StaticGaussians
    """Class of the model."""
    config: GaussiansConfig
    """The settings of the run; a derived class may annotate its own."""

    def __init__(self, config: GaussiansConfig) -> None:
        """Keep the settings of the run."""
        self.config = config
        self._ignore_time = isinstance(config, StaticGaussiansConfig) and config.ignore_time
        self._first_degree = 0
        self._shared_degree: int | None = None
        """The degree of all splats in this step, or OWN_DEGREES; ``None`` before the first."""

    def check_scene(self, scene: Scene) -> None:
        """Refuse captures of several times, and init=points without points.

        Raises:
            ConfigError: names the remedy.
        """
        if scene.is_dynamic and not self._ignore_time:
            raise ConfigError(
                f"{self.registered_as or 'this method'} is for static scenes, and "
                f"{scene.name!r} was captured at {scene.num_times} different times.",
                "Use a dynamic method (gsfw plugins lists them), or ignore_time=true to train on "
                "all times as if they were one; what moves becomes blurred.",
            )
        if self.config.init == "points" and len(usable_points(scene)[0]) == 0:
            raise ConfigError(
                f"init=points: {scene.name!r} brings {len(scene.points)} points, "
                "and none that can be used.",
                "Use init=dense, init=random, or give a splat file: init=FILE.",
            )

    def notes(self, scene: Scene) -> tuple[str, ...]:
        """Notes on the initialisation: its points and its unusual conditions."""
        notes = self._notes_of_bands()
        if scene.is_dynamic:
            notes.append(f"ignore_time=true: {scene.num_times} times are treated as one.")
        if self.config.init not in (AUTO, "points", "random"):
            return tuple(notes)
        points, _, dropped = usable_points(scene)
        if self.starts_at_random(points):
            why = "init=random" if self.config.init == "random" else "there are no points to use"
            notes.append(
                f"Starting from {self.random_points(scene):,} random splats ({why}). {RANDOM_COST}"
            )
            if self.config.random_region == "object" and object_place(scene) is None:
                notes.append(
                    "random_region=object: the cameras neither stand on a sphere nor look at one "
                    "point; splats start among the cameras."
                )
        else:
            notes += [f"Left out {n} initial points: {why}." for why, n in dropped.items()]
        return tuple(notes)

    def _notes_of_bands(self) -> list[str]:
        """Note on a run that is too short to add or to remove bands."""
        bands, every = self.config.bands, self.config.bands.every
        if self.config.sh != "adaptive":
            return []
        if bands.grow_stop < every:
            return [
                "sh=adaptive: no splat gets a band in this run, as the first look at them, after "
                f"bands.every={every} steps, comes after bands.grow_stop={bands.grow_stop}."
            ]
        if bands.stop // every == bands.grow_stop // every:
            return [
                "sh=adaptive: no band is taken away again in this run, as no multiple of "
                f"bands.every={every} lies above bands.grow_stop={bands.grow_stop} and up to "
                f"bands.stop={bands.stop}."
            ]
        return []

    def starts_at_random(self, points: Tensor) -> bool:
        """True if the initialisation without a file is random, given the usable points."""
        return self.config.init == "random" or len(points) == 0

    def random_points(self, scene: Scene) -> int:
        """Number of splats of a random initialisation: as given, or as the views can use."""
        given = self.config.random_points
        return random_count(scene.view_pixels) if given == "auto" else given

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> StaticGaussians:
        """Build Gaussians from the splats of a file, from the scene's points, or at random."""
        config = self.config
        if initial is not None:
            assert isinstance(initial.colors, Sh)
            self._first_degree = min(initial.colors.degree, config.sh_degree)
            start = from_splats(initial, config.sh_degree)
        else:
            start = self._from_scene(scene, operators, generator)
        rates = config.learning_rates(scene.extent)
        degrees = degrees_of(start.sh) if config.sh == "adaptive" and config.sh_degree else None
        extra = self.extra_columns(scene, len(start.means))
        return self.model_class(start, rates, degrees, extra)

    def extra_columns(self, scene: Scene, count: int) -> Mapping[str, Column]:
        """Further columns of the model, by name, for ``count`` rows; none by default.

        The model has them in ``model.extra``, by name.
        """
        return {}

    def refiners(self, scene: Scene, model: PrimitiveModel) -> tuple[Refiner, ...]:
        """Adaptive bands under sh=adaptive, and the opacity penalty."""
        assert isinstance(model, StaticGaussians)
        found = self.penalties()
        if model.evidence is None:
            return found
        return (AdaptiveBands(self.config.bands, model, len(scene.camera_centers)), *found)

    def penalties(self) -> tuple[Refiner, ...]:
        """The opacity penalty, if it has a weight."""
        weight = self.config.opacity_penalty
        return (OpacityPenalty(weight),) if weight > 0 else ()

    def _from_scene(
        self, scene: Scene, operators: Operators, generator: torch.Generator
    ) -> GaussianParameters:
        config = self.config
        points, colors, _ = usable_points(scene)
        if self.starts_at_random(points):
            count = self.random_points(scene)
            points, colors = random_points(scene, count, generator, config.random_region)
        start = from_points(
            points,
            colors,
            extent=scene.extent,
            scale=config.init_scale,
            opacity=config.init_opacity,
            sh_degree=config.sh_degree,
            operators=operators,
        )
        if scene.sky is None or len(scene.sky) == 0:
            return start
        return with_sky(start, scene.sky, config.sh_degree, operators)

    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """(1 - w) L1 + w (1 - SSIM): equation 7, with D-SSIM as in the released code.

        Squared differences take the place of L1 before the step ``squared_steps``, and with several
        times as one: L1 would show the median of all times, in which things that move are missing.
        """
        weight = self.config.ssim_weight
        rendered, target, valid = context.rendered.color, context.target, context.batch.valid
        blurs = self._ignore_time and context.batch.cameras.time is not None
        if context.step >= self.config.squared_steps and not blurs:
            l1, dssim = context.operators.l1_dssim(rendered, target, valid)
            return {"l1": (1.0 - weight) * l1, "dssim": weight * dssim}
        squares = self.config.squared_weight * masked_mean((rendered - target).square(), valid)
        if weight == 0:
            return {"squared": squares}
        _, dssim = context.operators.l1_dssim(rendered, target, valid)
        return {"squared": (1.0 - weight) * squares, "dssim": weight * dssim}

    def graph_key(self, step: int) -> Hashable | None:
        """The active degree and the phase of the losses."""
        if self._shared_degree is None:
            return None
        return self._shared_degree, step < self.config.squared_steps

    def state_dict(self) -> dict[str, Any]:
        """The SH degree of a file's splats: a resumed run does not read that file."""
        return {"first_degree": self._first_degree}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue with that degree."""
        self._first_degree = state["first_degree"]

    def prepare(
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Set the SH degree of the step; splats of a file keep their degree.

        If each splat has a degree of its own, that is the schedule.
        """
        assert isinstance(model, StaticGaussians)
        if model.evidence is not None:
            self._shared_degree = OWN_DEGREES
            return
        interval = self.config.sh_degree_interval
        scheduled = (step + 1) // interval if interval > 0 else model.degree
        model.active_degree = min(max(scheduled, self._first_degree), model.degree)
        self._shared_degree = model.active_degree
