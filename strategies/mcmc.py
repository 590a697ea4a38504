"""Density control as Markov chain Monte Carlo (Kheradmand et al. 2024).

Rows move by noise shaped by their covariance (equation 8), dead rows are relocated to live ones
sampled by opacity without a change of the image (equation 9), the number of rows grows to a
fixed limit, and opacities and scales are regularised towards zero (section 3.4).

Rows can also be sampled by the mean gradient of their screen position (FreeTimeGS, Wang et al.
2025), so that copies go to the regions with errors; this is off by default. The paper adds the two;
here each is divided by its sum first, so that neither depends on the number of pixels of an image.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.config import StrategyConfig
from gsfw.core.context import StepContext
from gsfw.core.model import POSITIONS, Children, DensifiableModel, PrimitiveModel
from gsfw.core.ranges import number
from gsfw.core.refiner import RefineContext, Refinement, Refiner
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Statistic
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.core.step_settings import steps_field
from gsfw.core.table import SplatTable
from gsfw.strategies.rounds import DensityRefiner, RefinementRounds


@dataclass
class McmcConfig(StrategyConfig):
    """Settings of MCMC density control; steps are those of a run of 30,000."""

    recommended: ClassVar[Mapping[str, Any]] = {"init_opacity": 0.5, "init_scale": 0.1}
    """Values of the paper's released code."""

    cap_max: int = number(1_000_000, at_least=1)
    """Limit of the growth; more splats at the start stay as many."""
    growth: float = number(0.05, at_least=0)
    """Splats added by each refinement, relative to those there are."""
    min_opacity: float = number(0.005, at_least=0)
    """Rows up to this opacity are dead, and are relocated."""
    gradient_share: float = number(0.0, at_least=0, at_most=1)
    """Part of the copies sampled by screen gradient, not by opacity (FreeTimeGS: 0.5); 0: none."""
    noise_lr: float = number(5e5, at_least=0)
    """Strength of the noise, times the learning rate of positions."""
    opacity_reg: float = number(0.01, at_least=0)
    """Weight of the mean opacity in the loss."""
    scale_reg: float = number(0.01, at_least=0)
    """Weight of the mean scale, in scene units, in the loss."""
    refine_start: int = steps_field(500, floor=100)
    """No relocation and no growth up to this step."""
    refine_stop: int = steps_field(25_000)
    """No relocation and no growth from this step on."""
    refine_every: int = steps_field(100, at_least=1, floor=20)
    """Steps between refinements; short runs refine, and so grow, in fewer rounds."""

    def needs(self) -> Needs:
        """Rows that can be relocated, and the screen gradient for a part of the copies."""
        drawn_by = frozenset({Feature.SCREEN_GRADIENT} if self.gradient_share else ())
        return Needs(features=drawn_by, densifiable=True)

    def refiners(self, scene: Scene) -> tuple[Refiner, ...]:
        """Relocation, growth and noise."""
        return (MarkovChainMonteCarlo(self),)


class MarkovChainMonteCarlo(DensityRefiner):
    """Relocates, grows and perturbs."""

    name = "mcmc"
    reads_images = False

    def __init__(self, config: McmcConfig) -> None:
        super().__init__(
            RefinementRounds(config.refine_start, config.refine_every, config.refine_stop)
        )
        self._config = config

    def statistics(self, step: int) -> frozenset[Statistic]:
        """The screen gradient if rows are sampled by it, while growth lasts."""
        gathers = self._config.gradient_share > 0 and step + 1 < self._config.refine_stop
        return frozenset({Statistic.SCREEN_GRADIENT} if gathers else ())

    def can_be_recorded(self, step: int) -> bool:
        """True: the terms depend on the parameters alone."""
        return True

    def regularizers(self, context: StepContext) -> Mapping[str, Tensor]:
        """Mean opacity and mean scale of the rendered splats, weighted."""
        return {
            "opacity_reg": self._config.opacity_reg * context.splats.opacities.mean(),
            "scale_reg": self._config.scale_reg * _standard_deviations(context.splats).mean(),
        }

    def observe(
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """Add up gradients by row if rows are sampled by them."""
        self.gather(context, statistics, statistics.screen_gradient)

    def refine(self, context: RefineContext) -> Refinement:
        """Relocate and grow every ``refine_every`` steps; add noise after every step."""
        config, table, model = self._config, context.table, context.model
        assert isinstance(model, DensifiableModel)
        counts: dict[str, int] = {}
        if self._rounds.due(context.done) and not context.limits.hold:
            counts["relocated"] = self._relocate(table, model, context.generator)
            wanted = math.ceil(len(table) * (1.0 + config.growth)) - len(table)
            number = context.limits.room(len(table), wanted, config.cap_max)
            counts["added"] = self._grow(table, model, context.generator, number)
            self._seen = None
        if context.done >= config.refine_stop:
            self._seen = None
        rate = config.noise_lr * table.learning_rate(POSITIONS, context.step)
        model.perturb_(rate, context.generator, context.operators)
        return counts

    def _relocate(
        self, table: SplatTable, model: DensifiableModel, generator: torch.Generator
    ) -> int:
        """Replace every dead row by a copy of a live one."""
        opacities = model.opacities()
        alive = opacities > self._config.min_opacity
        num_dead = len(alive) - int(alive.sum())
        if num_dead == 0 or num_dead == len(alive):
            return 0
        weights = self._weights(torch.where(alive, opacities, 0.0))
        chosen = draw_rows(weights, num_dead, generator)
        table.edit(alive, self._shared_out(chosen, table, model))
        if self._seen is not None:
            self._seen = self._seen.taken(torch.cat([alive.nonzero()[:, 0], chosen]))
        return num_dead

    def _grow(
        self, table: SplatTable, model: DensifiableModel, generator: torch.Generator, number: int
    ) -> int:
        """Add copies of rows sampled by opacity."""
        opacities = model.opacities()
        if number <= 0 or not bool(opacities.sum() > 0):
            return 0
        chosen = draw_rows(self._weights(opacities), number, generator)
        table.append(self._shared_out(chosen, table, model))
        return number

    def _weights(self, opacities: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """Sampling weights of rows; zero where the opacity is zero."""
        share = self._config.gradient_share
        if self._seen is None or share == 0:
            return opacities
        gradient = torch.where(opacities > 0, self._seen.mean_gradient, 0.0)
        if not bool(gradient.sum() > 0):
            return opacities
        return share * gradient / gradient.sum() + (1.0 - share) * opacities / opacities.sum()

    @staticmethod
    def _shared_out(
        chosen: Int[Tensor, " r"], table: SplatTable, model: DensifiableModel
    ) -> Children:
        """Thin the ``chosen`` rows to compensate for their copies, and return the copies."""
        sources, copies = chosen.unique(return_counts=True)
        table.replace(sources, model.relocated(sources, copies + 1))
        return model.clone_rows(chosen)


def draw_rows(
    weights: Float[Tensor, " n"], number: int, generator: torch.Generator
) -> Int[Tensor, " r"]:
    """Sample rows with replacement, in proportion to weights that are not all zero.

    By inversion of the cumulated weights: torch.multinomial has a limit of 2^24 rows.
    """
    cumulated = weights.double().cumsum(0)
    points = torch.rand(number, generator=generator, device=weights.device, dtype=torch.float64)
    # A point lies in [0, total): the first row whose cumulated weight exceeds it has weight > 0.
    return torch.searchsorted(cumulated, points * cumulated[-1], right=True).clamp_max(
        int(weights.nonzero()[-1])
    )


def _standard_deviations(splats: Splats) -> Float[Tensor, "n 3"]:
    """Scales; for covariances, the standard deviations along the axes of the scene."""
    if splats.scales is not None:
        return splats.scales
    assert splats.covariances is not None
    variances = splats.covariances.diagonal(dim1=1, dim2=2)
    return variances.clamp_min(torch.finfo(variances.dtype).tiny).sqrt()
