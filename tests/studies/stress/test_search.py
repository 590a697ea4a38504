"""A search for the worst: what a backend makes of splats that nobody thought of."""

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import HealthCheck, given, settings, target
from hypothesis import strategies as st

from gsfw.core.capabilities import Determinism
from gsfw.core.numerics import DEFAULT
from gsfw.core.render_settings import RenderSettings
from gsfw.kernels.cpu.native_module import NOT_BUILT, instruction_sets
from gsfw.rasterizers.cpu.rasterizer import CpuRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.entrants import Entrant
from gsfw.studies.stress.case import StressCase
from gsfw.studies.stress.catalogue.limits import Place, on_a_cut_off, placed
from gsfw.studies.stress.measure import Oracle, measure

pytestmark = pytest.mark.skipif(not instruction_sets(), reason=NOT_BUILT)

EXAMPLES = 30


def power(low: float, high: float) -> st.SearchStrategy[float]:
    """Powers of ten between two exponents."""
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


PLACES = st.builds(
    Place,
    scale=power(-9, 8),
    anisotropy=power(0.1, 7),
    depth=power(-5, 8),
    opacity=st.sampled_from([1 / 256, 1 / 255, 1 / 254, 0.5, 0.989, 0.991, 1.0])
    | st.floats(0.001, 1.0),
    offset=st.floats(-3, 3),
    focal=power(-1, 6),
    norm=power(-11, 18),
)


def entrant() -> Entrant:
    able = replace(CpuRasterizer.capabilities(), determinism=Determinism.BITWISE)
    return Entrant("cpu", CpuRasterizer(), able, torch.device("cpu"), (1,))


@settings(
    max_examples=EXAMPLES, derandomize=True, database=None,
    suppress_health_check=list(HealthCheck),
)  # fmt: skip
@given(PLACES, st.booleans())
@pytest.mark.slow
def test_no_place_is_worse_than_plain_float32_lets_it_be(place, cut_offs):
    profile = DEFAULT if cut_offs else DEFAULT.without_cutoffs()
    drawing = placed(place, RenderSettings(near=1e-9, profile=profile))
    # There any rounding decides: see catalogue/found.py, which keeps what this search has found.
    case = StressCase(
        f"found/{place}",
        lambda: drawing,
        conditioning="found by a search",
        at_a_cut_off=on_a_cut_off(place) if cut_offs else 0,
    )
    oracle = Oracle(ReferenceRasterizer())
    narrow = measure(entrant(), case, torch.float32, oracle)
    if narrow.forward > 0:
        target(math.log10(narrow.forward))
    assert not narrow.faults
    assert not measure(entrant(), case, torch.float64, oracle).faults
