"""Adaptive density control: clone, split and prune (Kerbl et al. 2023, section 5.2).

A row grows when the mean gradient of its screen position exceeds a threshold: small rows are
cloned, large ones split in two. Transparent rows are pruned, and after the first opacity reset
those that are large in the scene. ``absgrad`` sums each pixel's absolute gradient instead, which
does not cancel within a splat (Ye et al. 2024, AbsGS).

Where we differ from the released code: pruning by size on the screen is off by default, because
there the radii are zeroed before they are compared, so that it never happens; opacities are not
reset a further time for white backgrounds; and the number of rows has a limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.config import StrategyConfig, steps_field
from gsfw.core.context import StepContext
from gsfw.core.errors import ConfigError
from gsfw.core.model import Children, PrimitiveModel
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Statistic
from gsfw.core.scene import Scene
from gsfw.core.strategy import DensityStrategy, Refinement
from gsfw.core.table import SplatTable
from gsfw.strategies.row_statistics import RowStatistics

COPIES = 2
"""Children of a split row (Kerbl et al. 2023, section 5.2)."""


@dataclass
class AdcConfig(StrategyConfig):
    """Settings of adaptive density control; steps are those of a run of 30,000."""

    grow_gradient: float = 2e-4
    """Rows grow above this mean gradient of the screen position (NDC units)."""
    absgrad: bool = False
    """Whether to sum each pixel's absolute gradient instead (fewer, better placed splats)."""
    grow_absgrad: float = 8e-4
    """The threshold that takes the place of grow_gradient when absgrad is set."""
    split_size: float = 0.01
    """Growing rows are split above this standard deviation, in extents, and cloned below it."""
    prune_opacity: float = 0.005
    """Rows below this opacity are removed."""
    prune_size: float = 0.1
    """Rows above this deviation, in extents, are removed after the first reset; 0: none."""
    prune_radius: float = 0.0
    """Rows above this radius in pixels are removed after the first reset (papers: 20); 0: none."""
    refine_start: int = steps_field(500, at_least=100)
    """No refinement up to this step; before, most gradients only say that nothing has settled."""
    refine_stop: int = steps_field(15_000)
    """No refinement and no reset from this step on."""
    refine_every: int = steps_field(100, at_least=50)
    """Steps between refinements, in which gradients are gathered."""
    reset_every: int = steps_field(3000, at_least=300)
    """Steps between opacity resets, after which opacities have to recover; 0: no reset."""
    reset_opacity: float = 0.01
    """Opacities are capped at this by a reset."""
    max_gaussians: int = 3_000_000
    """No growth beyond this number (3 GB of parameters and optimizer state); 0: no limit."""

    def needs(self) -> Needs:
        """The gradient it grows by."""
        feature = Feature.ABSGRAD if self.absgrad else Feature.SCREEN_GRADIENT
        return Needs(features=frozenset({feature}))

    def build(self, scene: Scene) -> DensityStrategy:
        """The strategy.

        Raises:
            ConfigError: an interval or an opacity is out of range.
        """
        if self.refine_every < 1:
            raise ConfigError(
                f"strategy.refine_every={self.refine_every}: expected at least 1.",
                "Use strategy=none for no density control.",
            )
        if not 0 < self.reset_opacity < 1:
            raise ConfigError(
                f"strategy.reset_opacity={self.reset_opacity:g}: expected a number between 0 and 1."
            )
        return AdaptiveDensityControl(self, scene.extent)


class AdaptiveDensityControl(DensityStrategy):
    """Clones, splits and prunes by what the views since the last refinement have seen."""

    def __init__(self, config: AdcConfig, extent: float) -> None:
        self._config = config
        self._extent = extent
        self._seen: RowStatistics | None = None

    def statistics(self, step: int) -> frozenset[Statistic]:
        """The screen gradient, as long as there are refinements to come."""
        if step + 1 >= self._config.refine_stop:
            return frozenset()
        return frozenset({Statistic.ABSGRAD if self._config.absgrad else Statistic.SCREEN_GRADIENT})

    def observe(
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """Gather gradients, each as if its view had been the only one of its step."""
        gradient = statistics.absgrad if self._config.absgrad else statistics.screen_gradient
        if gradient is None or not self.statistics(context.step):
            return
        if self._seen is None:
            self._seen = RowStatistics(context.num_rows, gradient.device)
        views_in_step = len(context.batch.views) / context.share
        self._seen.add(
            gradient * views_in_step, statistics.radii, statistics.visible, context.splats.rows
        )

    def refine(
        self, step: int, table: SplatTable, model: PrimitiveModel, generator: torch.Generator
    ) -> Refinement:
        """Grow and prune every ``refine_every`` steps, reset opacities every ``reset_every``."""
        config, done = self._config, step + 1
        if done >= config.refine_stop:
            self._seen = None
            return {}
        counts: dict[str, int] = {}
        if done > config.refine_start and done % config.refine_every == 0:
            counts = self._refine(done, table, model, generator)
            self._seen = None
        if config.reset_every > 0 and done % config.reset_every == 0:
            table.reset_columns(model.lower_opacities_(config.reset_opacity))
            counts["reset"] = len(table)
        return counts

    def _refine(
        self, done: int, table: SplatTable, model: PrimitiveModel, generator: torch.Generator
    ) -> dict[str, int]:
        seen = self._seen or RowStatistics(len(table), table.device)
        grows = self._growing(seen.mean_gradient)
        large = model.sizes() > self._config.split_size * self._extent
        cloned, split = (grows & ~large).nonzero()[:, 0], (grows & large).nonzero()[:, 0]
        if len(cloned) or len(split):
            children = _joined(
                model,
                model.clone_rows(cloned, generator),
                model.split_rows(split, COPIES, generator),
            )
            table.edit(~(grows & large), children)
        born = torch.zeros(len(cloned) + COPIES * len(split), device=table.device)
        radii = torch.cat([seen.largest_radius[~(grows & large)], born])
        kept = self._kept(model, radii, resets_done=done > self._config.reset_every > 0)
        pruned = len(kept) - int(kept.sum())
        if pruned:
            table.keep(kept)
        return {"cloned": len(cloned), "split": len(split), "pruned": pruned}

    def _growing(self, gradient: Float[Tensor, " n"]) -> Bool[Tensor, " n"]:
        """Rows above the threshold; near the limit only those with the largest gradients."""
        config = self._config
        grows = gradient >= (config.grow_absgrad if config.absgrad else config.grow_gradient)
        room = config.max_gaussians - len(gradient)
        if config.max_gaussians > 0 and int(grows.sum()) > room:
            ranked = torch.where(grows, gradient, -1.0).argsort(descending=True, stable=True)
            grows[ranked[max(room, 0) :]] = False
        return grows

    def _kept(
        self, model: PrimitiveModel, radii: Float[Tensor, " n"], resets_done: bool
    ) -> Bool[Tensor, " n"]:
        """Rows that stay. The most opaque one always does: something has to be there to train."""
        config, opacities = self._config, model.opacities()
        kept = opacities >= config.prune_opacity
        if resets_done and config.prune_size > 0:
            kept &= model.sizes() <= config.prune_size * self._extent
        if resets_done and config.prune_radius > 0:
            kept &= radii <= config.prune_radius
        if len(kept) and not bool(kept.any()):
            kept[opacities.argmax()] = True
        return kept

    def state_dict(self) -> dict[str, Any]:
        """What was gathered since the last refinement."""
        return {} if self._seen is None else self._seen.state_dict()

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Go on gathering."""
        device = state["views"].device if state else None
        self._seen = None if device is None else RowStatistics.restored(state, device)


def _joined(model: PrimitiveModel, first: Children, second: Children) -> Children:
    """New rows of ``first``, then those of ``second``."""
    columns = model.columns()
    return {name: column.join(first[name], second[name]) for name, column in columns.items()}
