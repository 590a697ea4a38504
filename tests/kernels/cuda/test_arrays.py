"""Arrays that share an allocation, and the sizes of those that differ from image to image."""

import pytest
import torch

from gsfw.kernels.cuda.arrays import ALIGNMENT, STEPS_PER_OCTAVE, Arrays, capacity


def test_arrays_lie_apart_and_are_aligned():
    arrays = Arrays(
        torch.device("cpu"),
        {"a": (3, torch.int32), "none": (0, torch.int64), "b": (100, torch.float64)},
    )
    found = {name: arrays.tensor(name) for name in ("a", "b", "none")}
    found["a"].fill_(7)
    found["b"].fill_(0.5)
    assert found["a"].tolist() == [7] * 3
    assert found["b"].tolist() == [0.5] * 100
    assert len(found["none"]) == 0
    first = arrays.address("a")
    assert all((arrays.address(name) - first) % ALIGNMENT == 0 for name in found)
    assert arrays.address("b") == found["b"].data_ptr()
    assert arrays.address("absent") is None


@pytest.mark.parametrize("octave", [10, 17, 24])
def test_capacities_have_eight_sizes_per_octave(octave):
    counts = torch.randint(2**octave + 1, 2 ** (octave + 1), (2000,)).tolist()
    sizes = {capacity(count) for count in [*counts, 2**octave + 1, 2 ** (octave + 1)]}
    assert len(sizes) <= STEPS_PER_OCTAVE
    assert all(count <= capacity(count) <= 1.125 * count + 1 for count in counts)


def test_small_capacities_are_exact():
    assert [capacity(count) for count in range(17)] == list(range(17))
