"""ShorterBands: a stored model without the upper SH bands that an edit has set to zero."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gsfw.core.errors import UserError
from gsfw.core.exchange import StoredModel
from gsfw.core.maths.spherical_harmonics import num_coefficients
from gsfw.plugins.rebuild import rebuild
from gsfw.plugins.registry import Registry

SETTING, COLUMN = "sh_degree", "sh_rest"
"""Setting of methods whose models have as many bands, and the column that holds them."""


def without_bands(stored: StoredModel, degree: int, registry: Registry) -> StoredModel:
    """The model with coefficients up to a degree only, if its method can build such a model.

    Otherwise the model as it is: its upper bands are zero, and cost bytes.
    """
    column, setting = stored.columns.get(COLUMN), stored.settings.get(SETTING)
    if column is None or column.offsets is not None or not isinstance(setting, int):
        return stored
    if setting <= degree:
        return stored
    state, columns = dict(stored.state), dict(stored.columns)
    if degree == 0:
        del state[column.values], columns[COLUMN]
    else:
        count = num_coefficients(degree) - 1
        state[column.values] = state[column.values][:, :count].contiguous()
    settings = {**stored.settings, SETTING: degree}
    shorter = replace(stored, state=state, columns=columns, settings=settings)
    try:
        rebuild(shorter, Path("model"), registry)
    except UserError:  # Its other parts have as many bands, too.
        return stored
    return shorter
