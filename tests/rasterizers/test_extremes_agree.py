"""The catalogue of extremes, which is that of gsfw stress, for every backend that can run here."""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache

import pytest
import torch
from support.backends import BACKENDS, CUDA, EMULATED
from support.on_cuda import OnCuda
from support.scenes import front_camera

from gsfw.core.capabilities import Determinism
from gsfw.core.rasterizer import Rasterizer
from gsfw.rasterizers.cuda.rasterizer import CudaRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.entrants import Entrant
from gsfw.studies.stress.case import Section, StressCase, layers
from gsfw.studies.stress.catalogue import CASES
from gsfw.studies.stress.measure import Oracle, measure

# What is drawn here is drawn with checks by the tests of its parts.
pytestmark = pytest.mark.unchecked

CPU = torch.device("cpu")
DTYPES = [torch.float32, torch.float64]

TOO_LARGE = ("image/16384x64", "layers/100000-of-0.5", "layers/5000-seen-through")
"""What the emulation, which draws pixel by pixel, would take minutes for."""
AGAIN = ("/expected-depth", "/fisheye-no-cut-offs")
"""Variants whose paths through the kernels others have taken."""


SAMPLE = 8
"""Every eighth case of a backend is for every day, and the others are slow."""

DRAWN = [case for name, case in CASES.items() if not name.startswith("input/shape-of-")]
"""Tensors of wrong shapes do not come past the shape checks of the tests; core/test_rasterizer.py
has these."""


def emulation_takes(case: StressCase) -> bool:
    """Whether a case is for the emulation: not if it is large, or drawn as another has been."""
    large = case.section is Section.SIZE or case.name in TOO_LARGE
    return not large and not case.name.endswith(AGAIN)


def groups() -> list:
    """Backends and the cases that each is held to in one test: those of a section."""
    parts = []
    for backend in ("reference", "cpu", EMULATED, *CUDA):
        taken = [case for case in DRAWN if backend != EMULATED or emulation_takes(case)]
        daily = [case for case in taken if not case.name.endswith(AGAIN)][::SAMPLE]
        rest = [case for case in taken if case not in daily]
        parts += [(backend, daily, "a sample", False), (backend, rest, "the rest", True)]
    found = []
    for backend, cases, part, slow in parts:
        for section in Section:
            own = [case for case in cases if case.section is section]
            marks = [pytest.mark.slow] if slow or section is Section.SIZE else []
            marks += [pytest.mark.cuda] if backend in CUDA else []
            name = f"{backend}: {section.value}, {part}"
            found += [pytest.param(backend, own, marks=marks, id=name)] if own else []
    return found


@lru_cache(maxsize=1)
def oracle() -> Oracle:
    """One for all backends, which draws each case once."""
    return Oracle(ReferenceRasterizer(), keep=2000)


def entrant(rasterizer: Rasterizer) -> Entrant:
    """A backend of the conftest, which takes tensors on the CPU, wherever it draws."""
    behind = rasterizer.behind if isinstance(rasterizer, OnCuda) else rasterizer
    able = replace(behind.capabilities(), unavailable="", devices=frozenset({"cpu"}))
    if is_emulated(rasterizer):  # Its threads come in scrambled order.
        able = replace(able, determinism=Determinism.NONE)
    # That drawing again gives the same bits has tests of its own beside each backend.
    return Entrant(type(rasterizer).__name__, rasterizer, able, CPU, (1,))


def is_emulated(rasterizer: Rasterizer) -> bool:
    return isinstance(rasterizer, CudaRasterizer)  # On a GPU they are wrapped.


def dtypes(rasterizer: Rasterizer, case: StressCase) -> list[torch.dtype]:
    """Both, but for what is refused in any, and for what float64 has shown already.

    The reference in float64 is what all are measured against. Kernels are one source for both
    types, and the emulation takes minutes.
    """
    oracle_itself = isinstance(rasterizer, ReferenceRasterizer)
    shown = is_emulated(rasterizer) and case.name.count("/") > 1 and "no-cut-offs" not in case.name
    return DTYPES[:1] if case.refusal or oracle_itself or shown else DTYPES


def missed(rasterizer: Rasterizer, case: StressCase) -> Iterator[str]:
    """All that is wrong with how a backend takes a case."""
    for dtype in dtypes(rasterizer, case):
        result = measure(entrant(rasterizer), case, dtype, oracle())
        if result.not_claimed or result.faults or not result.passed or not result.finite:
            told = result.faults or (result.not_claimed or "not finite",)
            yield f"{case.name}, {result.dtype}: {'; '.join(told)}"


@pytest.mark.parametrize(("backend_name", "cases"), groups())
def test_a_section_of_the_catalogue_passes(backend_name, cases):
    rasterizer = BACKENDS[backend_name]()
    assert not [fault for case in cases for fault in missed(rasterizer, case)]


def test_equal_depths_are_drawn_by_row(backend):
    splats = layers(1000, 0.01, channels=3)
    backwards = splats.map(lambda tensor: tensor.flip(0))
    forth, back = (backend.render(s, front_camera(20, 15)).color for s in (splats, backwards))
    assert (forth - back).abs().max() > 1e-3, "the order of rows must show"
