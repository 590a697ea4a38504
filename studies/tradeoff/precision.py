"""Precision: every parameter rounded to a smaller type, as a file of that type would hold it."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import torch

from gsfw.core.model import PrimitiveModel
from gsfw.studies.tradeoff.subject import Subject

TYPES = {"fp16": torch.float16, "bf16": torch.bfloat16}
"""By the names people give them; the model as it is has fp32."""


def rounded(name: str) -> Callable[[Subject], Subject]:
    """The change that stores all parameters in a type and reads them back."""
    dtype = TYPES[name]

    def change(subject: Subject) -> Subject:
        model = rounded_model(subject.model, dtype)
        return replace(subject, model=model, float_bytes=dtype.itemsize)

    return change


def rounded_model(model: PrimitiveModel, dtype: torch.dtype) -> PrimitiveModel:
    """A copy whose numbers, before activation, are those that ``dtype`` has.

    What is too large for the type becomes infinite, and drawing then says which field it was.
    """
    copy = deepcopy(model)
    state = {
        name: tensor.to(dtype).to(tensor.dtype) if tensor.is_floating_point() else tensor
        for name, tensor in model.state_dict().items()
    }
    copy.load_state_dict(state)
    return copy
