"""Pace: how fast a run walks through its schedule, in steps of the schedule per update.

Every schedule of a run (learning rates, refinements, samplers, phases of methods and plugins) is a
function of the step, out of a fixed number of steps. A run that has to end in time cannot change
that number without tearing them all. It changes its pace instead: at pace 2 each update of the
optimizer stands for two steps of the schedule, at pace 0.5 two updates stand for one. So a schedule
follows the finished fraction of the plan, whoever wrote it, and ends where it was meant to end.

Decisions are made at updates, and recorded as text: the same decisions give the same bits again.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from gsfw.core.errors import ConfigError

UNIT = 1000
"""Paces are whole thousandths: positions are then exact on every machine."""
SLOWEST, FASTEST = 50, 1_000_000
"""Bounds of a pace, in thousandths."""
HASTE = 4
"""Above this times the planned pace no rows are added and no opacities are reset: too few updates
would follow, in which new rows are fitted and opacities recover."""
ALL_VIEWS = "all-views"
"""Word of a decision after which views that were held back are trained on too."""

_DECISION = re.compile(rf"(\d+):(\d+\.\d{{3}})(:{ALL_VIEWS})?")


@dataclass(frozen=True)
class Decision:
    """A change of pace."""

    update: int
    """Number of updates that were finished."""
    thousandths: int
    """Thousandths of a step of the schedule per update, from then on."""
    all_views: bool = False
    """True if views that were held back are trained on from then on."""

    def __str__(self) -> str:
        """The decision as it is recorded: "812:1.250"."""
        tail = f":{ALL_VIEWS}" if self.all_views else ""
        return f"{self.update}:{self.thousandths / UNIT:.3f}{tail}"

    @staticmethod
    def parse(text: str) -> Decision:
        """Read a recorded decision.

        Raises:
            ConfigError: it has another form, or its pace is out of range.
        """
        found = _DECISION.fullmatch(text)
        thousandths = round(float(found[2]) * UNIT) if found else 0
        if found is None or not SLOWEST <= thousandths <= FASTEST:
            raise ConfigError(
                f"pace={text}: expected UPDATE:PACE such as 812:1.250, a pace from "
                f"{SLOWEST / UNIT:g} to {FASTEST / UNIT:g} steps of the schedule per update.",
                "Runs with minutes= or until= record it in their config.yaml; use that as it is.",
            )
        return Decision(int(found[1]), thousandths, found[3] is not None)


class Pace:
    """The decisions of a run, and where they lead."""

    def __init__(self, decisions: Sequence[Decision] = ()) -> None:
        """Start at one step per update.

        Raises:
            ConfigError: the decisions are not in the order of their updates.
        """
        self._decisions: list[Decision] = []
        self._starts: list[int] = []
        for decision in decisions:
            self.decide(decision)

    @staticmethod
    def parse(texts: Sequence[str]) -> Pace:
        """The pace of recorded decisions.

        Raises:
            ConfigError: one has a wrong form, or they are not in order.
        """
        return Pace([Decision.parse(text) for text in texts])

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """All decisions, in order."""
        return tuple(self._decisions)

    @property
    def texts(self) -> tuple[str, ...]:
        """All decisions as they are recorded."""
        return tuple(str(decision) for decision in self._decisions)

    def decide(self, decision: Decision) -> None:
        """Change the pace from an update on.

        Raises:
            ConfigError: an earlier decision is for the same or a later update.
        """
        if self._decisions and decision.update <= self._decisions[-1].update:
            raise ConfigError(
                f"pace={self._decisions[-1]},{decision}: expected decisions in the order of their "
                "updates, at most one for each."
            )
        self._starts.append(self._position(decision.update))
        self._decisions.append(decision)

    def step(self, updates: int) -> int:
        """Number of steps of the schedule that are finished after so many updates."""
        return self._position(updates) // UNIT

    def _position(self, updates: int) -> int:
        """The place in the schedule, in thousandths of a step."""
        place = self._place(updates)
        if place < 0:
            return updates * UNIT
        decision, start = self._decisions[place], self._starts[place]
        return start + (updates - decision.update) * decision.thousandths

    def span(self, updates: int) -> int:
        """Number of steps of the schedule that the update after so many updates stands for."""
        return self.step(updates + 1) - self.step(updates)

    def thousandths(self, updates: int) -> int:
        """The pace of the update after so many updates."""
        place = self._place(updates)
        return UNIT if place < 0 else self._decisions[place].thousandths

    @property
    def planned(self) -> int:
        """The pace that the run was planned with, in thousandths: that of its first update.

        It is one step per update, or more where a sampler needs more steps than there are updates.
        """
        return max(self.thousandths(0), UNIT)

    def hastens(self, updates: int) -> bool:
        """True if the update after so many updates must add no rows."""
        return self.thousandths(updates) > HASTE * self.planned

    def all_views(self, updates: int) -> bool:
        """True if views that were held back are trained on after so many updates."""
        return any(item.all_views and item.update <= updates for item in self._decisions)

    def _place(self, updates: int) -> int:
        """Index of the decision in force; -1 before the first one."""
        place = len(self._decisions) - 1
        while place >= 0 and self._decisions[place].update > updates:
            place -= 1
        return place
