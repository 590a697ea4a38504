"""Method mip-splatting: 3dgs with the 3D smoothing filter and the 2D Mip filter.

Yu et al. 2024, "Mip-Splatting: Alias-free 3D Gaussian Splatting".
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from gsfw.api import (
    Column,
    Refiner,
    StaticGaussians,
    StaticGaussiansConfig,
    StaticGaussiansMethod,
    number,
    steps_field,
)
from gsfw_mip_splatting.sampling import SamplingRates

LARGEST = 1 - 1e-6
"""Opacities stay below 1, so that their logits are finite."""


@dataclass
class MipSplattingConfig(StaticGaussiansConfig):
    """Mip-Splatting (Yu et al. 2024)."""

    antialias: bool = True
    """The 2D Mip filter: opacity decreases with the dilation of a splat."""
    variance_2d: float = number(0.1, above=0)
    """Variance of the 2D Mip filter in pixels squared (the paper's); 3dgs has 0.3."""
    variance_3d: float = number(0.2, at_least=0)
    """Variance of the 3D filter in squared sampling intervals (s in the README); 0: no filter."""
    filter_every: int = steps_field(100, at_least=1, floor=10)
    """Steps between updates of the 3D filter, which is also updated after each edit of rows."""

    def build(self):
        return MipSplatting(self)


class SmoothedGaussians(StaticGaussians):
    """Gaussians that are convolved with a Gaussian of their own size before rendering."""

    def splats(self, time=None, cameras=None):
        plain = super().splats(time, cameras)
        scales, factors = self._smoothed()
        return replace(plain, scales=scales, opacities=plain.opacities * factors)

    def _smoothed(self):
        """Scales and opacity factors after the 3D smoothing filter."""
        scales = self.log_scales.values.exp()
        deviations = self.extra["filter"].values[:, None]
        wider = (scales.square() + deviations.square()).sqrt()
        return wider, (scales / wider).prod(dim=1)

    @torch.no_grad()
    def opacities(self):
        """Those that are rendered: what density control prunes and resets is what is seen."""
        return super().opacities() * self._smoothed()[1]

    @torch.no_grad()
    def change_opacities_(self, function):
        """The same opacities, so the filter's factor is undone."""
        _, factors = self._smoothed()
        factors = factors.double().clamp_min(1e-6)

        def of_rendered(opacities):
            rendered = opacities * factors
            changed = function(rendered)
            after = (changed / factors).clamp_max(LARGEST)
            return torch.where(changed == rendered, opacities, after)

        return super().change_opacities_(of_rendered)


class MipSplatting(StaticGaussiansMethod):
    model_class = SmoothedGaussians
    rates: SamplingRates

    def extra_columns(self, scene, count):
        return {"filter": Column(scene.points.new_zeros(count))}  # A buffer: it has no rate.

    def begin(self, scene, views, model):
        self.rates = SamplingRates(views.cameras)
        self.update(model)

    def update(self, model):
        """Set each row's filter: its standard deviation is sqrt(s) sampling intervals."""
        intervals = 1 / self.rates.of(model.means.values.detach())
        model.extra["filter"].values.copy_(self.config.variance_3d**0.5 * intervals)

    def refiners(self, scene, model):
        return (*super().refiners(scene, model), Smoothing(self))

    def render_settings(self, settings, step):
        return replace(
            settings, profile=replace(settings.profile, dilation=self.config.variance_2d)
        )


class Smoothing(Refiner):
    """Updates the filter on its schedule, and after edits of rows. It has no state of its own."""

    name = "mip-smoothing"

    def __init__(self, method):
        self.method = method

    def refine(self, context):
        if context.edits or context.done % self.method.config.filter_every == 0:
            self.method.update(context.model)
        return {}
