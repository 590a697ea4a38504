"""Comparing states bit for bit."""

import torch


def without_clock(state: dict) -> dict:
    """A state of a training without its seconds."""
    return {key: value for key, value in state.items() if key != "train_seconds"}


def assert_same_bits(first, second, where="state"):
    """Nested dictionaries and lists of tensors and plain data are equal to the last bit."""
    assert type(first) is type(second), where
    if isinstance(first, torch.Tensor):
        assert first.dtype == second.dtype, where
        assert torch.equal(first, second), where
    elif isinstance(first, dict):
        assert first.keys() == second.keys(), where
        for key in first:
            assert_same_bits(first[key], second[key], f"{where}.{key}")
    elif isinstance(first, list | tuple):
        assert len(first) == len(second), where
        for index, (one, other) in enumerate(zip(first, second, strict=True)):
            assert_same_bits(one, other, f"{where}[{index}]")
    else:
        assert first == second, where
