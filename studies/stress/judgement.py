"""Judgement: the tolerances that backends are held to, as sentences on what exceeds them.

Ordinary scenes: relative L2 of an image 1e-5, but for at most 0.05 % of its pixels, whose list of
splats may differ by a rounding at a cut-off (a flip); gradients 1e-3, without cut-offs 1e-4.
Where a case is ill-conditioned, as near as plain float32 is. Float64: 1e-12; where a case is
ill-conditioned, as near as the reference stays to itself when its inputs are rounded once more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from torch import Tensor

from gsfw.core.numerics import NumericsProfile
from gsfw.studies.stress.drawn import IMAGES, Drawn, distance

PIXEL = 1e-5
"""A pixel with a larger error has flipped."""
FLIP = 1e-2
"""Largest error of a pixel that has flipped."""
FLIPS = 5e-4
"""Largest part of the pixels that may flip; one pixel always may."""
GRADIENT, SMOOTH_GRADIENT, FLIPPED_GRADIENT = 1e-3, 1e-4, 1e-2
"""Bounds of gradients and statistics: with cut-offs, without, and where a pixel has flipped."""
FLOAT64 = 1e-12

ILL_IMAGE = 1e-4
"""Largest error of an ill-conditioned image in any case."""
NO_WORSE = 3.0
"""Factor by which a backend may exceed the errors of plain float32, since each rounds elsewhere."""
HOPELESS = 0.1
"""Error of plain float32 from which on even float64 is not trusted."""
FLOAT64_GAIN = 2.0**-29
"""Error of the same operations in float64, which has 29 bits more, as part of that in float32."""


def not_finite(found: Drawn) -> list[str]:
    """Names of everything with a NaN or an infinity."""
    return [f"{name} is not finite" for name, tensor in found.items() if not _is_finite(tensor)]


def _is_finite(tensor: Tensor) -> bool:
    return bool(tensor.isfinite().all())


def flips(found: Tensor, expected: Tensor) -> int:
    """Number of pixels whose error exceeds rounding."""
    return int((_per_pixel(found, expected) > PIXEL).sum())


def _per_pixel(found: Tensor, expected: Tensor) -> Tensor:
    unit = max(1.0, expected.abs().max().item()) if expected.numel() else 1.0
    return (found.double() - expected.double()).abs().amax(-1) / unit


def faults_of_float64(
    found: Drawn, expected: Drawn, bounds: Mapping[str, float] = MappingProxyType({})
) -> list[str]:
    """Faults of a float64 backend whose error exceeds rounding."""
    return [
        _too_far(name, found[name], tensor, bounds.get(name, FLOAT64))
        for name, tensor in expected.items()
        if not distance(found[name], tensor, name) <= bounds.get(name, FLOAT64)
    ]


def faults_of_float32(
    found: Drawn, expected: Drawn, profile: NumericsProfile, plain: Drawn | None = None
) -> list[str]:
    """Faults of a float32 backend by the tolerances of ordinary scenes.

    Args:
        found: in float32.
        expected: the reference in float64.
        profile: cut-offs of both.
        plain: the reference in float32, for scenes that may be less than ordinary: a gradient may
            then be as far off as ``NO_WORSE`` times its own.
    """
    faults, flipped = not_finite(found), 0
    if faults:
        return faults
    for name in IMAGES:
        if name in expected:
            count, of_image = _faults_of_image(found[name], expected[name], name)
            flipped += count
            faults += of_image
    smooth = profile.alpha_min == 0
    if smooth and flipped:
        faults.append(f"{flipped} pixels are off by more than {PIXEL:g}, and nothing is cut off")
    tolerance = FLIPPED_GRADIENT if flipped else SMOOTH_GRADIENT if smooth else GRADIENT
    for name, tensor in expected.items():
        bound = tolerance
        if plain is not None:
            bound = max(bound, NO_WORSE * distance(plain[name], tensor, name))
        if name not in IMAGES and not distance(found[name], tensor, name) <= bound:
            faults.append(_too_far(name, found[name], tensor, bound))
    return faults


def _faults_of_image(found: Tensor, expected: Tensor, name: str) -> tuple[int, list[str]]:
    """Number of flipped pixels, and the faults of an image."""
    difference = _per_pixel(found, expected)
    flipped = difference > PIXEL
    count, faults = int(flipped.sum()), []
    if count > max(1.0, FLIPS * difference.numel()):
        faults.append(f"{name}: {count} of {difference.numel()} pixels are off")
    # Expected depth is a ratio: at the rim of the only splat, it is that splat's or 0.
    if name != "depth" and difference.numel() and difference.max() > FLIP:
        faults.append(f"{name}: a pixel is off by {difference.max().item():.1e}")
    if distance(found[~flipped], expected[~flipped], name) > PIXEL:
        faults.append(_too_far(name, found[~flipped], expected[~flipped], PIXEL))
    return count, faults


def faults_of_flips(found: Drawn, expected: Drawn, splats: int) -> list[str]:
    """Faults of an image beyond the flips of some splats on a cut-off."""
    differences = {
        name: _per_pixel(found[name], expected[name]) for name in IMAGES if name in found
    }
    return [
        f"{name}: a pixel is off by {off.max().item():.1e}, at most {splats * FLIP:g} allowed"
        for name, off in differences.items()
        if off.numel() and not off.max() <= splats * FLIP
    ]


def faults_where_ill(found: Drawn, expected: Drawn, plain: Drawn) -> list[str]:
    """Faults of a float32 backend that is worse than plain float32, for an ill-conditioned case."""
    faults = not_finite(found)
    for name, tensor in expected.items():
        conditioned = distance(plain[name], tensor, name)
        if faults or not conditioned < HOPELESS:
            continue
        bound = max(ILL_IMAGE if name in IMAGES else GRADIENT, NO_WORSE * conditioned)
        if not distance(found[name], tensor, name) <= bound:
            faults.append(_too_far(name, found[name], tensor, bound))
    return faults


def faults_of_float64_where_ill(
    found: Drawn, expected: Drawn, plain: Drawn, nudged: Sequence[Drawn]
) -> list[str]:
    """Faults of a float64 backend against the reference in an ill-conditioned case.

    Args:
        found: in float64.
        expected: the reference in float64.
        plain: the reference in float32.
        nudged: the reference in float64 for inputs that are off by a few roundings. Its errors
            are those that any backward stable order of operations may have, on every processor;
            plain float32 is one sample of them, and may be exact by chance.
    """
    conditioned = {name: distance(plain[name], expected[name], name) for name in expected}
    known = {name: tensor for name, tensor in expected.items() if conditioned[name] < HOPELESS}
    bounds = {}
    for name, tensor in known.items():
        moved = max(distance(other[name], tensor, name) for other in nudged)
        bounds[name] = max(FLOAT64, NO_WORSE * max(moved, FLOAT64_GAIN * conditioned[name]))
    return not_finite(found) or faults_of_float64(found, known, bounds)


def _too_far(name: str, found: Tensor, expected: Tensor, bound: float) -> str:
    return f"{name} is off by {distance(found, expected, name):.1e}, at most {bound:.1e} allowed"
