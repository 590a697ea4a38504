"""Tests of gsfw.core.part_state: the states that a checkpoint can hold."""

import re
from collections import Counter, OrderedDict
from io import BytesIO

import numpy as np
import pytest
import torch

from gsfw.core.errors import ConfigError
from gsfw.core.part_state import load_part, state_of


class Part:
    """A part of a plugin."""

    def __init__(self, state) -> None:
        self._state = state

    def state_dict(self):
        return self._state

    def load_state_dict(self, state) -> None:
        self._state = state


class Cache:
    """A class of the plugin."""


CACHE = f"{__name__}.Cache"


@pytest.mark.parametrize(
    ("state", "message"),
    [
        ({"net": lambda x: x}, "has an object of the class function as ['net']"),
        ({"a": [1, {"b": Cache()}]}, f"has an object of the class {CACHE} as ['a'][1]['b']"),
        ({"rate": np.float64(1)}, "has an object of the class numpy.float64 as ['rate']"),
        ({Cache: 1}, "has an object of the class type as a key of the state"),
        ([1.0], "returned list, expected a dictionary."),
    ],
)  # fmt: skip
def test_a_value_that_no_checkpoint_can_hold_is_named_with_its_part_and_place(state, message):
    expected = f"Part of {__name__.partition('.')[0]}: state_dict {message}"
    with pytest.raises(ConfigError, match=f"^{re.escape(expected)}") as caught:
        state_of(Part(state))
    assert "make everything else anew in load_state_dict" in caught.value.advice


def test_a_state_that_is_taken_can_be_read_again():
    state = {
        "tensor": torch.ones(2), "none": None, "numbers": [True, 1, 2.0, 1j], "text": ("a", b"b"),
        "device": torch.device("cpu"), "dtype": torch.float32, "size": torch.Size([1]),
        "counts": Counter("ab"), "ordered": OrderedDict(a={1, 2}), 3: {},
    }  # fmt: skip
    file = BytesIO()
    torch.save(state_of(Part(state)), file)
    file.seek(0)
    part = Part({})
    load_part(part, torch.load(file, weights_only=True))
    assert part.state_dict().keys() == state.keys()
