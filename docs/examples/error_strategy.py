"""A strategy that clones where the image error is largest (after Rota Bulo et al. 2024).

The error of each pixel is summed over the contributions of each Gaussian. Every so many steps, the
rows with the largest sums are cloned.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from gsfw.api import Feature, Needs, Refiner, Spec, StrategyConfig, hookimpl, number, steps_field


@hookimpl
def gsfw_requires_api() -> str:
    return ">=1.0,<2"


@hookimpl
def gsfw_strategies() -> list[Spec]:
    return [Spec("by-error", "clones where the error is large", f"{__name__}:ByErrorConfig")]


@dataclass
class ByErrorConfig(StrategyConfig):
    every: int = steps_field(500, at_least=1, floor=10)
    """Steps between rounds of cloning."""
    share: float = number(0.05, above=0, at_most=1)
    """Rows cloned in a round, relative to those there are."""

    def needs(self) -> Needs:
        return Needs(features=frozenset({Feature.WEIGHTED_CONTRIBUTION}), densifiable=True)

    def refiners(self, scene):
        return (ByError(self),)


class ByError(Refiner):
    name = "by-error"

    def __init__(self, config):
        self.config, self.scores = config, None

    def before_backward(self, context, model):
        error = (context.rendered.color - context.target).detach().abs().mean(-1, keepdim=True)
        found = context.contributions(error).sum(0)
        if self.scores is None:
            self.scores = found.new_zeros(context.num_rows)
        rows = context.splats.rows
        self.scores.index_add_(0, torch.arange(len(found)) if rows is None else rows, found)

    def growth_due(self, step):
        return (step + 1) % self.config.every == 0

    def rows_edited(self):
        self.scores = None

    def refine(self, context):
        rows = len(context.table)
        number = context.limits.room(rows, int(self.config.share * rows))
        if not self.growth_due(context.step) or self.scores is None or number == 0:
            return {}
        rows = self.scores.argsort(descending=True, stable=True)[:number]
        context.table.append(context.model.clone_rows(rows, context.generator))
        return {"cloned": number}

    def state_dict(self):
        return {} if self.scores is None else {"scores": self.scores}

    def load_state_dict(self, state):
        self.scores = state.get("scores")
