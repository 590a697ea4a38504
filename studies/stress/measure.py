"""Measure: the result of a backend for a case, compared with the reference in float64."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from gsfw.core.capabilities import Determinism, Feature
from gsfw.core.errors import UserError
from gsfw.core.numerics import DEFAULT, PROFILES, NumericsProfile
from gsfw.core.rasterizer import Rasterizer
from gsfw.studies.entrants import Entrant
from gsfw.studies.stress.case import Drawing, StressCase
from gsfw.studies.stress.claimed import left_out, without
from gsfw.studies.stress.drawn import (
    GRADIENT,
    IMAGES,
    Drawn,
    distance,
    draw_everything,
    same_bits,
)
from gsfw.studies.stress.judgement import (
    faults_of_flips,
    faults_of_float32,
    faults_of_float64,
    faults_of_float64_where_ill,
    faults_where_ill,
    flips,
    not_finite,
)
from gsfw.studies.stress.result import CaseResult

Key = tuple[str, str, str, frozenset[Feature]]

ALL: frozenset[Feature] = frozenset()
"""No feature is left out of a case."""

NUDGES = (0, 1, 2)
"""Seeds of inputs that are off by roundings."""
NUDGE = 2.0**-51
"""Most by which a number of such an input is off, relatively: some roundings of float64."""

NUMBER = re.compile(r"(?<![-.\d])\d+")
"""A whole number that is not negative."""


class Oracle:
    """The reference: what a case looks like in float64, and what plain float32 makes of it."""

    def __init__(self, reference: Rasterizer, keep: int = 4) -> None:
        """Take the reference.

        Args:
            reference: draws in both types.
            keep: number of its latest drawings that are kept for the next backend.
        """
        self._reference, self._keep = reference, keep
        self._drawn: dict[Key, Drawn] = {}

    def expected(
        self, case: StressCase, profile: NumericsProfile, less: frozenset[Feature] = ALL
    ) -> Drawn:
        """Draw the reference in float64, or take the truth of a case that has its own.

        Args:
            case: the case.
            profile: constants to render with.
            less: features that are left out of the case, as for all functions here.
        """
        truth = case.make if case.truth is None else case.truth
        return self._draw(case, profile, "float64", lambda: truth().double(), less)

    def plain(
        self, case: StressCase, profile: NumericsProfile, less: frozenset[Feature] = ALL
    ) -> Drawn:
        """Draw the reference in float32, which tells how well a case is conditioned."""
        return self._draw(case, profile, "float32", case.make, less)

    def nudged(
        self, case: StressCase, profile: NumericsProfile, less: frozenset[Feature] = ALL
    ) -> list[Drawn]:
        """Draw in float64 for inputs off by some roundings, as other orders of sums may be.

        Positions are moved by the pose alone, all together, so that equal depths stay equal.
        """
        exact = case.make().double()
        return [
            self._draw(case, profile, f"nudge {seed}", partial(_nudged, exact, seed), less)
            for seed in NUDGES
        ]

    def _draw(
        self,
        case: StressCase,
        profile: NumericsProfile,
        how: str,
        make: Callable[[], Drawing],
        less: frozenset[Feature],
    ) -> Drawn:
        key = (case.name, profile.name, how, less)
        if key not in self._drawn:
            drawing = _with_profile(without(make(), less), profile)
            self._drawn[key] = draw_everything(self._reference, drawing)
            while len(self._drawn) > self._keep:
                del self._drawn[next(iter(self._drawn))]
        return self._drawn[key]


def _nudged(drawing: Drawing, seed: int) -> Drawing:
    """The drawing with every number but positions and colours off by at most ``NUDGE``, relatively.

    Colours are summed, which is well conditioned. Covariances stay positive as they are.
    """
    generator = torch.Generator().manual_seed(seed)

    def off(tensor: Tensor) -> Tensor:
        noise = torch.rand(tensor.shape, generator=generator, dtype=tensor.dtype) * 2 - 1
        return tensor * (1 + NUDGE * noise)

    cameras, splats = drawing.cameras, drawing.splats
    cameras = replace(
        cameras,
        world_to_camera=off(cameras.world_to_camera),
        intrinsics=off(cameras.intrinsics),
    )
    splats = replace(
        splats,
        opacities=off(splats.opacities).clamp(max=1),
        quats=None if splats.quats is None else off(splats.quats),
        scales=None if splats.scales is None else off(splats.scales),
    )
    return replace(drawing, cameras=cameras, splats=splats)


def measure(entrant: Entrant, case: StressCase, dtype: torch.dtype, oracle: Oracle) -> CaseResult:
    """Draw a case, go back, repeat it, and compare; nothing is raised, whatever happens."""
    name = str(dtype).removeprefix("torch.")
    result = CaseResult(case.name, case.section.value, entrant.name, name, note=case.conditioning)
    # A refusal may be due to the type.
    drawing = case.make() if dtype == torch.float32 or case.refusal else case.make().double()
    drawing = _with_profile(drawing, _profile_of(entrant, drawing))
    less = ALL if case.refusal else left_out(case, drawing, entrant.capabilities)
    drawing, words = without(drawing, less), tuple(sorted(feature.value for feature in less))
    result = replace(result, left_out=words)
    if not case.refusal:
        lacking = entrant.capabilities.lacking(drawing.needs(), entrant.device.type)
        if lacking:
            return replace(result, not_claimed=f"needs {', '.join(lacking)}", note="", left_out=())
    drawing = drawing.to(entrant.device)
    try:
        found, *again = [_drawn_with(threads, entrant, drawing) for threads in entrant.threads]
    except Exception as error:  # Whatever a backend raises is its result.
        return _raised(result, case, error)
    if case.refusal:
        return replace(result, faults=("was rendered, and has to be refused",))
    result = _compared(result, case, found, drawing, oracle, less)
    return _repeated(result, entrant, [same_bits(found, other) for other in again])


def _profile_of(entrant: Entrant, drawing: Drawing) -> NumericsProfile:
    """The profile of the case; that of the backend where it has only one."""
    profile, only = drawing.settings.profile, entrant.capabilities.profile
    return PROFILES[only] if only in PROFILES and profile == DEFAULT else profile


def _with_profile(drawing: Drawing, profile: NumericsProfile) -> Drawing:
    return replace(drawing, settings=replace(drawing.settings, profile=profile))


def _raised(result: CaseResult, case: StressCase, error: Exception) -> CaseResult:
    """A refusal where the case asks for it; else a fault."""
    message = " ".join(str(error).split())
    if not isinstance(error, ValueError | UserError):
        return replace(result, faults=(f"fails with {type(error).__name__}: {message}",))
    result = replace(result, refused=message)
    missing = [part for part in case.refusal if part not in message]
    if not case.refusal:
        return replace(result, faults=("was refused, and has to be rendered",))
    if not missing and max(map(int, NUMBER.findall(message)), default=0) < case.refused_number:
        missing = [f"a number of at least {case.refused_number}"]
    if missing:
        return replace(result, faults=(f"the refusal does not say {', '.join(missing)}",))
    return result


def _compared(
    result: CaseResult,
    case: StressCase,
    found: Drawn,
    drawing: Drawing,
    oracle: Oracle,
    less: frozenset[Feature],
) -> CaseResult:
    profile = drawing.settings.profile
    expected = oracle.expected(case, profile, less)
    if case.truth is not None:
        expected = {name: tensor for name, tensor in expected.items() if name in IMAGES}
    infinite = not_finite(found)
    if infinite:
        faults = infinite
    elif case.truth is not None:
        faults = [
            f"{name} is off by {distance(found[name], tensor, name):.1e}, "
            f"at most {case.bound:.1e} allowed"
            for name, tensor in expected.items()
            if not distance(found[name], tensor, name) <= case.bound
        ]
    elif case.at_a_cut_off:
        faults = faults_of_flips(found, expected, case.at_a_cut_off)
    elif case.conditioning and result.dtype == "float32":
        faults = faults_where_ill(found, expected, oracle.plain(case, profile, less))
    elif case.conditioning:
        plain, nudged = oracle.plain(case, profile, less), oracle.nudged(case, profile, less)
        faults = faults_of_float64_where_ill(found, expected, plain, nudged)
    elif result.dtype == "float32":
        faults = faults_of_float32(found, expected, profile)
    else:
        faults = faults_of_float64(found, expected)
    if found["alpha"].numel() and not (found["alpha"].min() >= 0 and found["alpha"].max() <= 1):
        faults.append("alpha is outside [0, 1]")
    errors = {name: distance(found[name], tensor, name) for name, tensor in expected.items()}
    color = (found["color"].double() - expected["color"].double()).abs()
    return replace(
        result,
        faults=tuple(faults),
        forward=color.max().item(),
        relative=errors["color"],
        gradient={n.removeprefix(GRADIENT): e for n, e in errors.items() if n.startswith(GRADIENT)},
        others={n: e for n, e in errors.items() if n != "color" and not n.startswith(GRADIENT)},
        flips=flips(found["color"], expected["color"]),
        finite=not infinite,
    )


def _repeated(result: CaseResult, entrant: Entrant, same: Sequence[bool]) -> CaseResult:
    """Compare a backend with its claim of determinism."""
    if not same:
        return result
    result = replace(result, deterministic=all(same))
    if all(same) or entrant.capabilities.determinism is Determinism.NONE:
        return result
    fault = f"has other bits when rendered again (threads: {', '.join(map(str, entrant.threads))})"
    return replace(result, faults=(*result.faults, fault))


def _drawn_with(threads: int, entrant: Entrant, drawing: Drawing) -> Drawn:
    with _threads(threads):
        return draw_everything(entrant.rasterizer, drawing)


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Set the number of threads of torch, and with it of native kernels."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
