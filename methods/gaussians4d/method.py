"""Method 4dgs: Gaussians in a canonical space, and a field that deforms them over time.

Wu et al. 2024, "4D Gaussian Splatting for Real-Time Dynamic Scene Rendering"; Yang et al. 2024,
"Deformable 3D Gaussians for High-Fidelity Monocular Dynamic Scene Reconstruction" (encoder mlp);
Mueller et al. 2022 (encoder hash). A coarse phase trains static Gaussians; a fine one trains them
with the field (section 5 of Wu et al.).

Differences from the released code of Wu et al.: the field starts as the identity; learning rates
of Gaussians and optimizer state continue through the change of phase; opacities are not reset.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import TYPE_CHECKING, Literal

import torch

from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.methods.gaussians3d.model import StaticGaussians
from gsfw.methods.gaussians4d.box import SpaceBox
from gsfw.methods.gaussians4d.decoder import Decoder, HiddenLayers
from gsfw.methods.gaussians4d.encoder import Encoder
from gsfw.methods.gaussians4d.field import OPACITIES, DeformationField
from gsfw.methods.gaussians4d.frequency import FrequencyMlp
from gsfw.methods.gaussians4d.hash_grid import HashGrid
from gsfw.methods.gaussians4d.hexplane import HexPlane
from gsfw.methods.gaussians4d.model import DeformedGaussians
from gsfw.methods.moving.method import MovingMethod

if TYPE_CHECKING:
    from gsfw.methods.gaussians4d.config import DeformationConfig

VIEWS_PER_CELL = 4
"""Training views in each cell along time. Motion shatters if every view has a cell of its own:
100 instead of 25 cells cost 2 dB on dynamic/robot, which has 100 views at 100 times."""
CELLS_PER_TIME = 2
"""Most cells for each captured time. The smoothness over time then also ties neighbours together
where each captured time has enough views for cells of its own."""
MIN_TIMES = 2
"""Fewest cells along time: the first and the last time."""
MAX_TIMES = 100
"""Most cells along time if they follow from the capture (Wu et al. 2024 have 25 to 150)."""


class DeformationMethod(MovingMethod):
    """Trains static Gaussians in the coarse steps; then these and the field together."""

    def __init__(self, config: DeformationConfig) -> None:
        super().__init__(config, config)
        self.config = config

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> DeformedGaussians:
        """Canonical Gaussians as in method 3dgs, and a field."""
        config = self.config
        canonical = self.canonical.build_model(scene, operators, generator, initial)
        means = canonical.means.values.detach()
        near = means if scene.sky is None else means[~scene.sky.holds(means)]
        box = SpaceBox(near, scene.extent)
        encoder = _encoder(config, scene, operators, generator)
        decoder = _decoder(config, encoder, canonical, operators, generator)
        field = DeformationField(box, encoder, decoder)
        return DeformedGaussians(
            canonical,
            field,
            config.optim.field_rates(config.coarse_steps),
            self.still_rows(canonical.num_rows),
            sum_of_scales=config.scale_change == "sum",
        )

    def prepare(
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Set the phases and the SH degree of the step."""
        assert isinstance(model, DeformedGaussians)
        config = self.config
        model.deforming = step >= config.coarse_steps
        # Under squared differences much is hidden that moves into sight later: without it, 500
        # steps of mujoco_collision end with 8 Gaussians.
        model.settled = step >= max(config.coarse_steps, config.squared_steps)
        super().prepare(step, model, optimizer, time)

    def graph_key(self, step: int) -> Hashable | None:
        """The key that all moving methods share, and the phase."""
        shared = self.shared_key(step)
        return None if shared is None else (shared, step >= self.config.coarse_steps)


def _time_cells(given: int | Literal["auto"], scene: Scene) -> int:
    """Cells along time: a given number, as many as times, or as many as the views determine."""
    if given != "auto" and given > 0:
        return given
    cells = scene.num_times
    if given == "auto":
        views = round(len(scene.camera_centers) / VIEWS_PER_CELL)
        cells = min(views, CELLS_PER_TIME * scene.num_times)
    return max(min(cells, MAX_TIMES), MIN_TIMES)


def _encoder(
    config: DeformationConfig, scene: Scene, operators: Operators, generator: torch.Generator
) -> Encoder:
    """The chosen encoder, initialised at random."""
    if config.encoder == "hexplane":
        planes = config.hexplane
        return HexPlane(planes, _time_cells(planes.times, scene), operators, generator)
    if config.encoder == "hash":
        times = _time_cells(config.hash.times, scene)
        return HashGrid(config.hash, times, operators, generator)
    return FrequencyMlp(config.mlp, generator)


def _decoder(
    config: DeformationConfig,
    encoder: Encoder,
    canonical: StaticGaussians,
    operators: Operators,
    generator: torch.Generator,
) -> Decoder:
    """The decoder of that encoder's features."""
    outputs = {"means": 3, "log_scales": 3, "quats": 4}
    if config.deform_opacity:
        outputs[OPACITIES] = 1
    if config.deform_sh:
        outputs["sh"] = 3 * (canonical.degree + 1) ** 2
    if config.encoder == "mlp":  # Its layers are the encoder's own, and its outputs are linear.
        layers = HiddenLayers(encoder.features, depth=0, head_width=0)
    else:
        sizes = config.hexplane if config.encoder == "hexplane" else config.hash
        usual = sizes.width if sizes.depth else 0
        heads = usual if sizes.head_width == "auto" else sizes.head_width
        layers = HiddenLayers(sizes.width, sizes.depth, heads)
    return Decoder(encoder.features, layers, outputs, operators, generator)
