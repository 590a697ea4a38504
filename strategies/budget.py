"""Budget: how many Gaussians a model may end with, as users say it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.config import AUTO, StrategyConfig, steps_field
from gsfw.core.errors import ConfigError
from gsfw.core.model import PrimitiveModel

NONE = "none"
"""No budget: the strategy is as its paper has it."""

MEGABYTE = 1_000_000


@dataclass
class BudgetConfig(StrategyConfig):
    """How many Gaussians to end with, for strategies that grow; none by default."""

    budget: str = NONE
    """Gaussians to end with: none, auto (as the scene needs), a number, or megabytes as in 20MB."""
    budget_share: float = 0.025
    """Under budget=auto, each round of pruning removes what holds less than this of all there is.
    """
    budget_every: int = steps_field(1500, floor=50)
    """Under a budget, steps between rounds of pruning, in which what is left makes up for it."""

    def needs(self) -> Needs:
        """Contributions, where there is a budget."""
        wanted = {Feature.CONTRIBUTION} if str(self.budget) != NONE else set()
        return Needs(features=frozenset(wanted))

    def parsed_budget(self) -> Budget:
        """What ``budget`` says.

        Raises:
            ConfigError: that is nothing which it could say, or a setting is out of range.
        """
        if self.budget_every < 1:
            raise ConfigError(f"strategy.budget_every={self.budget_every}: expected at least 1.")
        if not 0 < self.budget_share < 1:
            raise ConfigError(
                f"strategy.budget_share={self.budget_share:g}: expected a number between 0 and 1."
            )
        text = str(self.budget)
        number, megabytes = re.fullmatch(r"\d+", text), re.fullmatch(r"(\d+(?:\.\d+)?)MB", text)
        if text in (NONE, AUTO):
            return Budget(text)
        if number and int(text) > 0:
            return Budget(text, rows=int(text))
        if megabytes and float(megabytes[1]) > 0:
            return Budget(text, num_bytes=float(megabytes[1]) * MEGABYTE)
        raise ConfigError(
            f"strategy.budget={text}: expected none, auto, a number of Gaussians such as 50000, "
            "or megabytes such as 20MB."
        )


@dataclass(frozen=True)
class Budget:
    """A budget that makes sense."""

    text: str
    """As it was given."""
    rows: int | None = None
    """Most rows."""
    num_bytes: float | None = None
    """Most bytes of what is trained of each row."""

    @property
    def is_given(self) -> bool:
        """Whether there is one."""
        return self.text != NONE

    def most_rows(self, model: PrimitiveModel) -> int | None:
        """Rows that it allows, at the mean size that they have now; ``None`` where the scene says.

        One row is always allowed: something has to be there to train.
        """
        if self.num_bytes is None:
            return self.rows
        trained = [column.values for column in model.columns().values() if column.trained]
        in_all = sum(values.nbytes for values in trained)
        return max(int(self.num_bytes * model.num_rows / max(in_all, 1)), 1)
