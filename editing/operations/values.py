"""Values: numbers in the text of an operation."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float64
from torch import Tensor


def numbers(text: str, expected: str) -> tuple[float, ...]:
    """Finite numbers with commas between them, as many as the words of ``expected``.

    Raises:
        ValueError: there are others, or other words.
    """
    words = text.split(",")
    try:
        found = tuple(float(word) for word in words)
    except ValueError:
        found = ()
    if len(found) != len(expected.split(",")) or not all(map(math.isfinite, found)):
        raise ValueError(f"expected {expected}, found {text!r}")
    return found


def number(text: str, expected: str, least: float, most: float = math.inf) -> float:
    """One finite number in a range.

    Raises:
        ValueError: it is not.
    """
    try:
        found = float(text)
    except ValueError:
        found = math.nan
    if not (least <= found <= most and math.isfinite(found)):
        raise ValueError(f"expected {expected}, found {text!r}")
    return found


def whole(text: str, expected: str) -> int:
    """A whole number of at least 1.

    Raises:
        ValueError: it is not.
    """
    if not (text.isascii() and text.isdigit() and int(text) >= 1):
        raise ValueError(f"expected {expected}, found {text!r}")
    return int(text)


def point(values: tuple[float, ...]) -> Float64[Tensor, " 3"]:
    """Three numbers as a vector."""
    return torch.tensor(values, dtype=torch.float64)
