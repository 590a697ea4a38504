"""Runner: every chosen case for every backend, method and dtype."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import torch

from gsfw.core.rasterizer import Rasterizer
from gsfw.plugins.registry import Registry
from gsfw.studies.entrants import REFERENCE, Entrant, entrant_of
from gsfw.studies.stress.catalogue import CASES, chosen
from gsfw.studies.stress.measure import Oracle, measure
from gsfw.studies.stress.moving_case import MOVING_CASES, moving_model
from gsfw.studies.stress.moving_measure import measure_moving
from gsfw.studies.stress.result import CaseResult

DTYPES = {"float32": torch.float32, "float64": torch.float64}
"""Types of the cases by name."""

NAMES = (*CASES, *(case.name for case in MOVING_CASES))
"""Names of all cases."""


@dataclass(frozen=True)
class StressPlan:
    """The cases to measure."""

    entrants: Sequence[Entrant]
    methods: Sequence[str] = ()
    """Dynamic methods, for the cases of time."""
    dtypes: Sequence[str] = tuple(DTYPES)
    only: Sequence[str] = field(default_factory=tuple)
    """Names or patterns of cases; empty for all."""

    @property
    def names(self) -> list[str]:
        """Names of the chosen cases.

        Raises:
            ConfigError: a pattern matches none.
        """
        return chosen(NAMES, self.only)

    def __len__(self) -> int:
        names = self.names
        rendered = [CASES[name] for name in names if name in CASES]
        once = sum(bool(case.refusal) for case in rendered)
        per_entrant = once + (len(rendered) - once) * len(self.dtypes)
        moving = (len(names) - len(rendered)) * len(self.dtypes)
        return per_entrant * len(self.entrants) + moving * len(self.methods)


def run(plan: StressPlan, registry: Registry) -> Iterator[CaseResult]:
    """Measure; yields each result at once.

    Raises:
        ConfigError: a pattern matches no case, or a method is not there.
    """
    names = set(plan.names)
    oracle = Oracle(reference(registry))
    for case in CASES.values():
        if case.name in names:
            # A refusal holds in any type; some cases are refused for theirs.
            for dtype in plan.dtypes[:1] if case.refusal else plan.dtypes:
                for entrant in plan.entrants:
                    yield measure(entrant, case, DTYPES[dtype], oracle)
    moving = [case for case in MOVING_CASES if case.name in names]
    for method in plan.methods if moving else ():
        model = moving_model(method, registry)
        for moving_case in moving:
            for dtype in plan.dtypes:
                yield measure_moving(moving_case, method, model, DTYPES[dtype])


def reference(registry: Registry) -> Rasterizer:
    """The rasterizer that all are measured against."""
    return entrant_of(REFERENCE, registry).rasterizer
