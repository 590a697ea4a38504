"""Parametrizations of which plain ``pytest`` takes a sample; the other cases are slow tests."""

from collections.abc import Container, Sequence
from typing import Any

import pytest
from _pytest.mark import ParameterSet


def sampled(cases: Sequence[tuple[Any, ...]], daily: Container[int]) -> list[ParameterSet]:
    """All cases, those at other places than ``daily`` marked slow."""
    return [
        pytest.param(*case, marks=[] if place in daily else [pytest.mark.slow])
        for place, case in enumerate(cases)
    ]
