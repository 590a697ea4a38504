"""Promises of the edits of a model: what density control asks of a DensifiableModel."""

from __future__ import annotations

from collections.abc import Callable

import torch

from gsfw.core.model import Children, DensifiableModel
from gsfw.core.table import SplatTable
from gsfw.testing.method_trial import method_trial
from gsfw.testing.promise import NotApplicable, Promise, require
from gsfw.testing.subject import Subject
from gsfw.testing.table_checks import check_table

ADVICE = "Return new rows for every name in columns(), as many as were asked for."


def _fresh(subject: Subject) -> tuple[DensifiableModel, SplatTable, Callable[[str], None]]:
    """A model before its first step, its table, and a check of both.

    Raises:
        NotApplicable: the model cannot be densified.
    """
    parts = method_trial(subject, "edits", {}).composition().parts
    model = parts.model
    if not isinstance(model, DensifiableModel):
        raise NotApplicable("its model is not a DensifiableModel")
    return model, parts.table, lambda when: check_table(model, parts.optimizer, when)


def _edits_keep_columns(subject: Subject) -> None:
    model, table, check = _fresh(subject)
    rows = torch.arange(min(3, model.num_rows))
    generator = torch.Generator().manual_seed(0)
    points = torch.zeros(2, 3)
    # New rows by the name of their function, and the number of rows that they add.
    children: dict[str, tuple[Children, int]] = {
        "clone_rows": (model.clone_rows(rows), len(rows)),
        "split_rows": (model.split_rows(rows, 2, generator), 2 * len(rows)),
        "rows_at": (model.rows_at(points, points + 0.5, torch.full((2,), 0.1), 0.5), 2),
        "relocated": (model.relocated(rows, torch.full_like(rows, 2)), 0),
    }
    for name, (made, count) in children.items():
        before = len(table)
        try:
            if name == "relocated":
                table.replace(rows, made)
            else:
                table.append(made)
        except ValueError as error:
            require(False, f"{name}: {error}.", ADVICE)
        added = len(table) - before
        require(added == count, f"{name} gives {added} rows, expected {count}.", ADVICE)
        check(f"after {name}")
    table.keep(torch.arange(len(table)) % 2 == 0)
    check("after half of the rows were dropped")


def _opacities_change(subject: Subject) -> None:
    model, _, check = _fresh(subject)
    before = model.opacities()
    changed = model.change_opacities_(lambda opacities: opacities.clamp(max=0.01))
    check("after change_opacities_")
    off = (model.opacities() - before.clamp(max=0.01)).abs().max().item()
    require(
        off <= 1e-4,
        f"after opacities were capped at 0.01, the error of one is {off:.2g}.",
        "Apply the function to activated opacities, and store the result before its activation.",
    )
    unknown = sorted(set(changed) - set(model.columns()))
    require(not unknown, f"change_opacities_ names {unknown}.", "Return names of columns.")
    state = {name: column.values.clone() for name, column in model.columns().items()}
    model.change_opacities_(lambda opacities: opacities)
    same = all(torch.equal(state[name], c.values) for name, c in model.columns().items())
    require(
        same,
        "bits of a column change under a function that changes no opacity.",
        "Store only the rows whose opacity changes.",
    )


def _children_are_alike(subject: Subject) -> None:
    model, table, _ = _fresh(subject)
    count = model.num_rows
    rows = torch.arange(min(4, count))
    sizes, opacities = model.sizes()[rows], model.opacities()[rows]
    require(
        bool(((model.opacities() >= 0) & (model.opacities() <= 1)).all()),
        "an opacity is outside [0, 1].",
        "Return activated values from opacities().",
    )
    table.append(model.clone_rows(rows))
    table.append(model.split_rows(rows, 2, torch.Generator().manual_seed(0)))
    end = count + len(rows)
    cloned, split = model.opacities()[count:end], model.sizes()[end:]
    require(
        torch.allclose(cloned, opacities),
        "a clone has another opacity than its row.",
        "Copy every column in clone_rows.",
    )
    require(
        bool((split < sizes.repeat(2)).all()),
        "a child of split_rows is not smaller than its parent.",
        "Divide the scales of children by a number above 1; order them child by child.",
    )


EDITS = (
    Promise(
        "edits-keep-columns",
        "Cloned, split, relocated and new rows have a value in every column.",
        _edits_keep_columns,
    ),
    Promise(
        "opacities-change-as-asked",
        "change_opacities_ sets activated opacities, and keeps the bits of all other rows.",
        _opacities_change,
    ),
    Promise(
        "children-are-alike",
        "Clones have the opacity of their row, and split rows are smaller.",
        _children_are_alike,
    ),
)
