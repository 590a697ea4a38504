"""Codebooks: the least squared error, at any distribution."""

import numpy as np
import pytest

from gsfw.core.maths.codebook import LEVELS, codebook, nearest_levels


def squared_error(values, levels):
    return float(np.square(values - levels[nearest_levels(values, levels)].astype(float)).sum())


def least_error(values):
    """Least squared error by dynamic programming over all values."""
    ordered = np.sort(values)
    sums = np.concatenate([[0], np.cumsum(ordered)])
    squares = np.concatenate([[0], np.cumsum(ordered**2)])
    ends = np.arange(len(sums))
    counts = np.maximum(ends - ends[:, None], 1)
    cost = (squares - squares[:, None]) - (sums - sums[:, None]) ** 2 / counts
    cost[ends[:, None] > ends] = np.inf
    best = cost[0]
    for _ in range(LEVELS - 1):
        best = (best[:, None] + cost).min(axis=0)
    return float(best[-1])


DISTRIBUTIONS = {
    "normal": lambda random: random.standard_normal(450),
    "heavy tails": lambda random: random.standard_t(2, size=450),
    "two heaps far apart": lambda random: random.standard_normal(450) + 1000 * (np.arange(450) % 2),
    "many equal": lambda random: np.round(random.standard_normal(450), 2),
}


@pytest.mark.parametrize("kind", DISTRIBUTIONS)
def test_the_error_is_near_the_least_there_is(kind):
    values = DISTRIBUTIONS[kind](np.random.default_rng(0))
    assert squared_error(values, codebook(values)) <= 1.25 * least_error(values) + 1e-6


@pytest.mark.parametrize("count", [1, 2, 255, 256])
def test_few_values_are_kept_as_they_are(count):
    values = np.random.default_rng(0).standard_normal(count).astype(np.float32)
    levels = codebook(np.repeat(values, 3))
    assert np.array_equal(levels[nearest_levels(values, levels)], values)
    assert np.array_equal(levels, np.sort(levels))


def test_each_value_has_the_index_of_the_nearest_level():
    values = np.random.default_rng(0).standard_normal((500, 3)).astype(np.float32)
    levels = codebook(values)
    chosen = np.abs(values - levels[nearest_levels(values, levels)])
    least = np.abs(values[..., None] - levels).min(axis=-1)
    assert np.allclose(chosen, least, atol=1e-6)
