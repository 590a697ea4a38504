"""Verb my-part: prints the spread of the values of a trained model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from gsfw.api import ConfigError, Console, RunOptions, open_run, read_options
from torch import Tensor

SPREAD = ("low", "middle", "high")
"""Names of the columns of values."""


@dataclass(kw_only=True)
class MyPartOptions(RunOptions):
    """Print the columns of a trained model, and the spread of their values."""

    examples: ClassVar[tuple[str, ...]] = ("gsfw my-part latest",)

    share: float = 0.05
    """Part of a column's values that lies below low, and above high."""


def run(words: list[str]) -> int:
    """Open the run, and print a line for each column of its model."""
    options = read_options("my-part", MyPartOptions, words)
    if not 0 <= options.share <= 0.5:
        raise ConfigError(f"share={options.share:g}: expected a number from 0 to 0.5.")
    opened = open_run(options.run, options.data, options.device)
    columns: dict[str, dict[str, Any]] = {
        name: {"shape": [*column.values.shape], **_spread(column.values, options.share)}
        for name, column in opened.model.columns().items()
    }
    rows = [
        [name, "x".join(map(str, found["shape"])), *(f"{found[key]:.4g}" for key in SPREAD)]
        for name, found in columns.items()
    ]
    console = Console(options.json)
    title = f"{opened.name}: {opened.model.num_rows} rows after {opened.step} steps"
    console.table(["column", "shape", *SPREAD], rows, title)
    console.result({"rows": opened.model.num_rows, "step": opened.step, "columns": columns})
    return 0


def _spread(values: Tensor, share: float) -> dict[str, float]:
    """The values below which a share, half, and all but a share of them lie; NaN for none."""
    ordered = values.detach().double().flatten().sort().values
    if len(ordered) == 0:
        return dict.fromkeys(SPREAD, math.nan)
    places = (round(part * (len(ordered) - 1)) for part in (share, 0.5, 1 - share))
    return {name: float(ordered[place]) for name, place in zip(SPREAD, places, strict=True)}
