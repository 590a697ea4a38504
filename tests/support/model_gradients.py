"""Gradients of models against finite differences."""

from collections.abc import Callable, Collection, Sequence

import torch
from torch import Tensor

from gsfw.core.model import PrimitiveModel


def drawn(model: PrimitiveModel, time: Tensor) -> tuple[Tensor, ...]:
    """The tensors of a model's splats."""
    return tuple(model.splats(time).tensors().values())


def check_gradients(
    model: PrimitiveModel,
    outputs: Callable[[], Sequence[Tensor]],
    without: Collection[str] = (),
) -> None:
    """Require that gradients of all trained columns, in float64, are finite differences.

    Args:
        model: of the columns.
        outputs: tensors that depend on them.
        without: columns whose gradients are stopped in part.
    """
    inputs = [
        column.values
        for name, column in model.columns().items()
        if column.trained and name not in without
    ]
    assert torch.autograd.gradcheck(
        lambda *_: tuple(outputs()), inputs, atol=1e-8, rtol=1e-6, fast_mode=True
    )
