"""The campaign of processors: it finds bits that follow the threads, and results out of bounds."""

from dataclasses import replace

import pytest
import torch
from processors import ALWAYS, PROCESSORS, Processor, available, draw, names_of_cases, on

from gsfw.core.rasterizer import Rasterizer
from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


class Broken(Rasterizer):
    """The reference, whose colours are off by a factor."""

    def __init__(self, factor) -> None:
        self._factor, self._reference = factor, ReferenceRasterizer()

    @classmethod
    def capabilities(cls):
        return ReferenceRasterizer.capabilities()

    def _render(self, splats, cameras, settings):
        output = self._reference._render(splats, cameras, settings)
        return replace(output, color=output.color * self._factor())


def test_a_sound_rasterizer_passes():
    tried = draw(ALWAYS, Broken(lambda: 1), (1, 2))
    assert (tried.drawn, tried.faults, tried.other_bits) == (2, [], [])


def test_bits_that_follow_the_number_of_threads_are_found():
    tried = draw(ALWAYS, Broken(lambda: 1 + 1e-13 * torch.get_num_threads()), (1, 2))
    (line,) = tried.other_bits  # In float32 a factor so near to 1 is 1.
    assert line.startswith(f"{ALWAYS[0]}, float64: has other bits")


def test_results_beyond_their_bounds_are_found():
    tried = draw(ALWAYS, Broken(lambda: 1 + 1e-3), (1, 1))
    assert any(line.startswith(f"{ALWAYS[0]}, float64: color is off by") for line in tried.faults)
    assert not tried.other_bits


def test_cases_are_drawn_by_lot_and_the_known_one_always():
    assert names_of_cases(5, seed=1) == names_of_cases(5, seed=1)
    assert names_of_cases(5, seed=1) != names_of_cases(5, seed=2)
    assert names_of_cases(1, seed=7) == list(ALWAYS)


def test_every_instruction_set_of_this_machine_is_a_processor():
    assert set(instruction_sets()) <= {each.needs for each in PROCESSORS}
    assert all(each.needs in instruction_sets() for each in available())


@pytest.mark.slow
@pytest.mark.skipif(not instruction_sets(), reason=NOT_BUILT)
def test_a_processor_without_fused_multiplication_draws_within_the_bounds():
    tried = on(available()[-1], names_of_cases(3, seed=0))
    assert (tried.drawn, tried.faults, tried.other_bits) == (6, [], [])


@pytest.mark.slow
@pytest.mark.skipif(not instruction_sets(), reason=NOT_BUILT)
def test_a_process_that_fails_is_told():
    with pytest.raises(RuntimeError, match="no such set: exit"):
        on(Processor("no such set", {"GSFW_CPU_ISA": "avx1024"}), ALWAYS)
