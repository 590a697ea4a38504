"""Budget: growth that stops when it no longer pays, then pruning by contribution.

Under ``budget=auto`` the scene decides; under a number or megabytes the model may grow to twice as
many rows, and keeps those with the largest contributions. ``contribution`` cites the papers. Rules:

1. *Growth stops* half-way at the latest, or when for two points of the curve in a row an added
   Gaussian gains less than the removal of one of the least useful would cost. The gain is the
   decrease of the loss of the same views since their last render, between two points, per added
   Gaussian; it includes the gain of training alone, so that growth stops late rather than early.
   The cost is the mean contribution of the rows that pruning would remove first, times ``PRICE``.
   Growth does not restart: later rounds have less time to pay. Under a number, only the allowed
   rows and half the run end growth: there the user has set the price.
2. *Pruning* has ``ROUNDS`` rounds once growth has stopped, ``budget_every`` steps apart. A round
   renders every training view once, while rows do not change. Rows rank by their largest fraction
   of any view. The lowest rows are removed whose sum is below ``budget_share`` of the total, but
   at most ``LARGEST_ROUND``; or, under a number, as many as lead there in equal ratios.
3. No opacity is reset once growth has stopped: contributions would be invalid.

Measured on fox (180 x 320, 2000 steps, one seed; without a budget 106,403 rows and 31.32 dB). Half
of the rows at once, after growth: by the sum of contributions over views -0.80 dB, by the mean over
the views that saw a row -0.36 dB. The sum removes the rows of few views first, which leaves holes:
one held-out view lost 3.5 dB. In four rounds: by the mean 56 % of the rows at -0.06 dB, by the
largest 46 % at -0.11 dB, by ``budget_share`` of it, without a limit, 49 % at -0.05 dB, and as here
51 % at -0.03 dB. Pruning during growth (five rounds that keep 75 %, by the sum) ended with 57 % at
-0.95 dB, and growth that stops at 49 % with -0.56 dB. Measuring contributions adds 1 % to the time
of rendering and its backward pass.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.config import AUTO, NO_BUDGET, StrategyConfig
from gsfw.core.context import StepContext
from gsfw.core.contributions import most_useful
from gsfw.core.errors import ConfigError
from gsfw.core.model import DensifiableModel, PrimitiveModel
from gsfw.core.refinement.contribution import Contributions
from gsfw.core.refinement.refiners import checked_refiners
from gsfw.core.refinement.view_losses import ViewLosses
from gsfw.core.refiner import GrowthLimits, RefineContext, Refinement, Refiner
from gsfw.core.render_output import RenderStatistics
from gsfw.core.render_settings import Statistic
from gsfw.core.scene import Scene
from gsfw.core.table import SplatTable

MEGABYTE = 1_000_000
HEADROOM = 2
"""Most rows during growth, relative to the budget's number."""
ROUNDS = 4
"""Number of rounds of pruning."""
LARGEST_ROUND = 0.2
"""Largest fraction of the rows that a round removes under ``auto``: the rest has to compensate."""
PASSES = 3
"""Most images of a round, per view: sampled at random, these include 95 % of the views."""
PATIENCE = 2
"""Points of the curve in a row that end growth: a single one may be chance."""
PRICE = 0.2
"""Loss per removed fraction of the images (fox: about 0.011 at once for 5.2 % of them)."""


@dataclass(frozen=True)
class BudgetSize:
    """A parsed budget: rows, bytes, or as many as the scene requires."""

    text: str
    """The text of the setting."""
    rows: int | None = None
    """Most rows."""
    num_bytes: float | None = None
    """Most bytes of the trained columns."""

    @property
    def is_given(self) -> bool:
        """True if there is a budget."""
        return self.text != NO_BUDGET

    @staticmethod
    def parse(config: StrategyConfig) -> BudgetSize:
        """Parse the budget of a strategy's settings.

        Raises:
            ConfigError: the text has none of the forms of a budget.
        """
        text = str(config.budget)
        found = BudgetSize(text) if text in (NO_BUDGET, AUTO) else BudgetSize.amount(text)
        if found is None:
            raise ConfigError(
                f"strategy.budget={text}: expected none, auto, a number of Gaussians such as "
                "50000, or megabytes such as 20MB."
            )
        return found

    @staticmethod
    def amount(text: str) -> BudgetSize | None:
        """Parse a number of rows, or megabytes; ``None`` if the text is neither."""
        number, megabytes = re.fullmatch(r"\d+", text), re.fullmatch(r"(\d+(?:\.\d+)?)MB", text)
        if number and int(text) > 0:
            return BudgetSize(text, rows=int(text))
        if megabytes and float(megabytes[1]) > 0:
            return BudgetSize(text, num_bytes=float(megabytes[1]) * MEGABYTE)
        return None

    def most_rows(self, model: PrimitiveModel) -> int | None:
        """Rows that fit, at their current mean size; ``None`` if the scene decides.

        At least one row is allowed: training needs one.
        """
        if self.num_bytes is None:
            return self.rows
        trained = [column.values for column in model.columns().values() if column.trained]
        total = sum(values.nbytes for values in trained)
        return max(int(self.num_bytes * model.num_rows / max(total, 1)), 1)


class Budget(Refiner):
    """Stops growth and prunes by contribution; works with any strategy."""

    name = "budget"

    def __init__(
        self, size: BudgetSize, config: StrategyConfig, scene: Scene, growth_ends: int | None
    ) -> None:
        """Start without statistics.

        Args:
            size: the parsed budget; not "none".
            config: settings of the rounds of pruning.
            scene: its training views are rendered in a round of pruning.
            growth_ends: steps after which the strategy adds no more rows; ``None`` if never.
        """
        self._config, self._budget, self._growth_ends = config, size, growth_ends
        self._num_views = max(len(scene.camera_centers), 1)
        self._seen: Contributions | None = None
        self._losses = ViewLosses()
        self._curve: list[dict[str, Any]] = []
        self._poor = self._rounds = self._calm = 0
        self._stopped: int | None = None
        self._why = ""

    @property
    def grows(self) -> bool:
        """True if rows may still be added, and opacities reset."""
        return self._stopped is None

    def statistics(self, step: int) -> frozenset[Statistic]:
        """Contributions, for the price of growth or for a due round of pruning."""
        wanted = self._has_to_pay if self.grows else self._is_looking(step)
        return frozenset({Statistic.CONTRIBUTION} if wanted else ())

    @property
    def _has_to_pay(self) -> bool:
        """True under ``auto``: growth has to pay."""
        return self._budget.rows is None and self._budget.num_bytes is None

    def _is_looking(self, step: int) -> bool:
        """True during a round of pruning: views are measured, and rows must not change."""
        if self._stopped is None or self._rounds == ROUNDS:
            return False
        first = max(self._stopped, self._calm)
        return step >= first + self._rounds * self._config.budget_every

    def limits(self, step: int, model: PrimitiveModel) -> GrowthLimits:
        """Twice the rows of a number during growth; no change of rows during a round."""
        most = self._budget.most_rows(model)
        max_rows = None if most is None else HEADROOM * most
        return GrowthLimits(self.grows, self._is_looking(step), max_rows)

    def can_be_recorded(self, step: int) -> bool:
        """Not in a round of pruning: the host counts the views that were measured."""
        return not self._is_looking(step)

    def observe(
        self, context: StepContext, statistics: RenderStatistics, model: PrimitiveModel
    ) -> None:
        """Gather losses and contributions; no synchronisation."""
        if self._rounds < ROUNDS:
            self._losses.add(context, statistics)
        if statistics.contribution is not None and self.statistics(context.step):
            if self._seen is None:
                self._seen = Contributions(context.num_rows, statistics.contribution.device)
            self._seen.add(context, statistics)

    def refine(self, context: RefineContext) -> Refinement:
        """End growth, or prune; judge growth before other refiners add rows."""
        pruned = self._advance(context)
        if context.growth_due and not self._is_looking(context.step):
            self._before_growth(context.done, len(context.table))
        return {"pruned": pruned} if pruned else {}

    def _advance(self, context: RefineContext) -> int:
        """End growth, or prune a round; return the number of pruned rows."""
        done, table, model = context.done, context.table, context.model
        ended = self._growth_ends is not None and done >= self._growth_ends
        if self.grows and (ended or context.steps <= 2 * done):
            self._stop(done, "the strategy ends it" if ended else "half of the run is over")
        most = self._budget.most_rows(model)
        if done == context.steps and most is not None and len(table) > most:
            return self._keep(done, self._scores(model), most, table)
        if self._is_looking(done - 1) and self._has_looked():
            return self._round_of_pruning(done, table, model)
        return 0

    def _has_looked(self) -> bool:
        """True if every view was rendered, or so many images that the sampler omits some views."""
        if self._seen is None:
            return False
        enough = self._seen.num_images >= PASSES * self._num_views
        return enough or self._seen.num_views >= self._num_views

    def _before_growth(self, done: int, num_rows: int) -> None:
        """Judge whether the latest added rows have paid."""
        if not self.grows:
            return
        if self._losses.num_compared >= self._num_views:
            self._judge(done, num_rows)
        self._seen = None  # New rows have no contributions yet.

    def rows_edited(self) -> None:
        """Drop contributions after a change of rows."""
        self._seen = None

    def opacities_reset(self, step: int) -> None:
        """Wait until losses and contributions have recovered."""
        self._losses.forget()
        self._calm = step + 1 + self._config.budget_every

    def _judge(self, done: int, num_rows: int) -> None:
        """Add a point to the curve, and stop growth that no longer pays."""
        gain = cost = None
        if self._curve:
            steps, added = (
                done - self._curve[-1]["step"],
                num_rows - self._curve[-1]["num_gaussians"],
            )
            gain = self._losses.gain_per_step * steps / added if added > 0 else None
        if self._has_to_pay and self._seen is not None:
            cost = self._cost(self._seen)
        self._note(done, num_rows, 0, gain, cost)
        if gain is not None and cost is not None:
            self._poor = self._poor + 1 if gain < cost else 0
        if self._poor == PATIENCE:
            self._stop(done, "another Gaussian gains less than the least useful ones contribute")

    def _cost(self, seen: Contributions) -> float | None:
        """Cost of the removal of one of the least useful rows."""
        least = least_useful(seen.largest, self._config.budget_share)
        return PRICE * float(seen.mean[least].mean()) if len(least) else None

    def _stop(self, done: int, why: str) -> None:
        self._stopped, self._why, self._seen = done, why, None

    def _round_of_pruning(self, done: int, table: SplatTable, model: PrimitiveModel) -> int:
        scores, most, number = self._scores(model), self._budget.most_rows(model), len(table)
        left = ROUNDS - self._rounds
        if most is None:
            least = len(least_useful(scores, self._config.budget_share))
            keep = number - min(least, int(LARGEST_ROUND * number))
        else:
            keep = number if most >= number else math.floor(number * (most / number) ** (1 / left))
            keep = min(keep, most) if left == 1 else keep
        pruned = self._keep(done, scores, max(keep, 1), table)
        self._rounds, self._seen = self._rounds + 1, None
        return pruned

    def _scores(self, model: PrimitiveModel) -> Float[Tensor, " n"]:
        """Usefulness of rows: the largest contribution, or the opacity if a view is missing.

        The missing view may be the only one that shows a row.
        """
        if self._seen is not None and self._has_looked():
            return self._seen.largest
        if isinstance(model, DensifiableModel):
            return model.opacities()
        if self._seen is not None:
            return self._seen.largest
        return torch.zeros(model.num_rows, device=next(model.parameters()).device)

    def _keep(self, done: int, scores: Float[Tensor, " n"], number: int, table: SplatTable) -> int:
        """Keep the rows of the highest scores, in their order; of equal ones the first."""
        pruned = max(len(table) - number, 0)
        if pruned:
            table.keep(most_useful(scores, number))
        self._note(done, len(table), pruned, None, None)
        return pruned

    def _note(
        self, done: int, num_rows: int, pruned: int, gain: float | None, cost: float | None
    ) -> None:
        point = {"step": done, "num_gaussians": num_rows, "loss": self._losses.mean_loss}
        found = {"gain_per_gaussian": gain, "cost_per_gaussian": cost, "pruned": pruned}
        self._curve.append({**point, **found})
        self._losses.clear()

    def report(self) -> dict[str, Any]:
        """The curve, and the step and cause of the end of growth."""
        stopped = {"stopped_growing_at": self._stopped, "why": self._why}
        return {"budget": self._budget.text, "curve": list(self._curve), **stopped}

    def state_dict(self) -> dict[str, Any]:
        """Tensors and plain data."""
        return {
            "curve": list(self._curve),
            "losses": self._losses.state_dict(),
            "seen": None if self._seen is None else self._seen.state_dict(),
            "counts": [self._poor, self._rounds, self._calm],
            "stopped": self._stopped,
            "why": self._why,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``; start anew from a checkpoint without a budget."""
        if not state:
            return
        self._curve, seen = list(state["curve"]), state["seen"]
        self._losses.load_state_dict(state["losses"])
        self._seen = None if seen is None else Contributions.restored(seen)
        self._poor, self._rounds, *_, self._calm = state["counts"]  # 0.1.0 has the steps too.
        self._stopped, self._why = state["stopped"], state["why"]


def least_useful(scores: Float[Tensor, " n"], share: float) -> Int[Tensor, " r"]:
    """Rows of the lowest scores, whose sum is below a share of the total."""
    order = scores.argsort(stable=True)
    held = scores[order].double().cumsum(0)
    return order[: int((held < share * held[-1]).sum())] if len(held) else order


def with_budget(strategy: StrategyConfig, scene: Scene) -> tuple[Refiner, ...]:
    """The refiners of a strategy, after the budget of its settings, if any.

    Raises:
        ConfigError: the budget has none of its forms.
    """
    size = BudgetSize.parse(strategy)
    found = checked_refiners(f"{type(strategy).__name__}.refiners", strategy.refiners(scene))
    if not size.is_given:
        return found
    ends = [refiner.growth_ends for refiner in found if refiner.growth_ends is not None]
    return (Budget(size, strategy, scene, max(ends, default=None)), *found)
