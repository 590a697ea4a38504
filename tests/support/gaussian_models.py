"""Stored models of random Gaussians, still and moving."""

from dataclasses import replace

import torch

from gsfw.core.column import Layout
from gsfw.core.exchange import StoredColumn
from support.stored_models import some_model

COUNT = 300
STATIC = {
    "means": (3,), "quats": (4,), "log_scales": (3,), "opacity_logits": (),
    "sh_dc": (1, 3), "sh_rest": (3, 3),
}  # fmt: skip


def gaussians(count=COUNT, **more):
    """A model of random Gaussians, with further columns (name: layout and values)."""
    generator = torch.Generator().manual_seed(0)
    columns, state = {}, {}

    def add(name, layout, values):
        ragged = layout is Layout.RAGGED
        columns[name] = StoredColumn(
            layout, f"{name}.values", f"{name}.offsets" if ragged else None
        )
        state[f"{name}.values"] = values

    for name, shape in STATIC.items():
        add(name, Layout.DENSE, torch.randn(count, *shape, generator=generator))
    state["log_scales.values"] -= 4
    for name, (layout, values) in more.items():
        add(name, layout, values)
        if layout is Layout.RAGGED:  # One value in every second row.
            lengths = torch.arange(count) % 2
            starts = torch.cat([torch.zeros(1, dtype=torch.int64), lengths.cumsum(0)])
            state[f"{name}.offsets"] = starts
    return replace(some_model(), rows=count, columns=columns, state=state)


def moving(count=COUNT):
    generator = torch.Generator().manual_seed(1)

    def values(*shape):
        return torch.randn(*shape, generator=generator)

    return gaussians(
        count,
        motion=(Layout.RAGGED, values(count // 2, 2, 3)),
        time_centers=(Layout.RAGGED, values(count // 2).sigmoid()),
        past_means=(Layout.STACKED, values(4, count, 3)),
        past_quats=(Layout.STACKED, (3e4 * values(4, count, 4).tanh()).short()),
        stillness=(Layout.RAGGED, values(count // 2, 2)),
        mine=(Layout.DENSE, values(count, 2)),
        huge=(Layout.DENSE, 1e6 * values(count)),
    )
