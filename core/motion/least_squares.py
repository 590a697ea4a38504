"""Weighted least squares of many rows at once: polynomials, and Gaussian windows of opacities."""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from gsfw.core.motion.evaluation import recentered

RIDGE = 1e-13
"""Relative to the largest entry of the normal equations, which have condition numbers of 1e4."""
CONSTANT = 1e-4
"""Largest change of an opacity that is constant; a pixel has 255 levels."""
FAINTEST = 1e-12
"""Opacities below this have no logarithm worth fitting."""
UNSEEN = 0.5 / 255
"""Opacity of a row where it is absent, if it is seen too seldom for a parabola."""


@dataclass(frozen=True)
class Polynomials:
    """Polynomials of p pieces in a time of their own, (t - origin) / unit, which is near 1."""

    coefficients: Float[Tensor, "p powers d"]
    """Coefficients of each power, from power 0."""
    origin: Float[Tensor, " p"]
    unit: Float[Tensor, " p"]

    def at(self, times: Float[Tensor, "p m"]) -> Float[Tensor, "p m d"]:
        """Values at times, for each piece."""
        own = ((times - self.origin[:, None]) / self.unit[:, None])[..., None]
        total = torch.zeros_like(own)
        for coefficient in reversed(self.coefficients.unbind(1)):
            total = total * own + coefficient[:, None]
        return total

    def about(self, centers: Float[Tensor, " p"]) -> Float[Tensor, "p powers d"]:
        """Coefficients of the powers of t - center."""
        shifted = recentered(self.coefficients, (centers - self.origin) / self.unit)
        powers = torch.arange(shifted.shape[1])
        return shifted / self.unit[:, None, None] ** powers[:, None]


def fit_polynomials(
    times: Float[Tensor, "p m"],
    weights: Float[Tensor, "p m"],
    values: Float[Tensor, "p m d"],
    degree: int,
) -> Polynomials:
    """The polynomials of least weighted squares; of lower degree where too few weights are > 0.

    Args:
        times: of the samples of each piece.
        weights: not negative.
        values: to fit.
        degree: the largest.
    """
    total = weights.sum(1).clamp_min(torch.finfo(weights.dtype).tiny)
    origin = (weights * times).sum(1) / total
    unit = ((weights * (times - origin[:, None]) ** 2).sum(1) / total).sqrt()
    unit = torch.where(unit > 0, unit, 1.0)
    own = (times - origin[:, None]) / unit[:, None]
    design = own[..., None] ** torch.arange(degree + 1)
    supported = (weights > 0).sum(1)[:, None] > torch.arange(degree + 1)
    design = design * supported[:, None]
    weighted = (weights / total[:, None])[..., None] * design
    normal = design.transpose(1, 2) @ weighted
    ridge = RIDGE * normal.amax((1, 2), keepdim=True).clamp_min(1.0)
    normal = normal + ridge * torch.eye(degree + 1).to(normal)
    return Polynomials(torch.linalg.solve(normal, weighted.transpose(1, 2) @ values), origin, unit)


@dataclass(frozen=True)
class Windows:
    """Opacities of p pieces: peak exp(-((t - center) / width)^2)."""

    center: Float[Tensor, " p"]
    width: Float[Tensor, " p"]
    """Infinity for a constant opacity."""
    peak: Float[Tensor, " p"]
    """In [0, 1]."""

    def at(self, times: Float[Tensor, "p m"]) -> Float[Tensor, "p m"]:
        """Values at times, for each piece."""
        elapsed = (times - self.center[:, None]) / self.width[:, None]
        return self.peak[:, None] * torch.exp(-(elapsed**2))

    def error(
        self, times: Float[Tensor, "p m"], there: Bool[Tensor, "p m"], values: Float[Tensor, "p m"]
    ) -> Float[Tensor, " p"]:
        """The largest difference from ``values``, of the samples that are ``there``."""
        return ((self.at(times) - values).abs() * there).amax(1)

    def where_better(
        self,
        others: Windows,
        times: Float[Tensor, "p m"],
        there: Bool[Tensor, "p m"],
        values: Float[Tensor, "p m"],
    ) -> Windows:
        """These windows where their error is small, or no larger than that of ``others``."""
        error = self.error(times, there, values)
        return self.where(
            (error <= CONSTANT) | (error <= others.error(times, there, values)), others
        )

    def where(self, chosen: Bool[Tensor, " p"], others: Windows) -> Windows:
        """These windows where ``chosen``, and others elsewhere."""
        return Windows(
            torch.where(chosen, self.center, others.center),
            torch.where(chosen, self.width, others.width),
            torch.where(chosen, self.peak, others.peak),
        )


def fit_windows(
    times: Float[Tensor, "p m"], there: Bool[Tensor, "p m"], opacities: Float[Tensor, "p m"]
) -> Windows:
    """The windows that are nearest to opacities.

    The logarithm of a Gaussian window is a parabola, found by least squares with the squared
    opacity as weight, which makes differences of logarithms to those of opacities. Where it opens
    upwards, or has its vertex far from the piece, the vertex is fixed.

    Args:
        times: of the samples of each piece, ascending.
        there: true for the samples of a piece; the others are padding.
        opacities: in [0, 1]; 0 where a row is absent.
    """
    seen = there & (opacities > FAINTEST)
    few = seen.sum(1, keepdim=True) < 3
    known = torch.where(there & few, opacities.clamp_min(UNSEEN), opacities * there)
    weights = torch.where(known > FAINTEST, known**2, 0.0)
    logarithms = torch.where(known > FAINTEST, known, 1.0).log()
    free, rises = _of_parabolas(fit_polynomials(times, weights, logarithms[..., None], 2))
    low = torch.where(there, times, torch.inf).amin(1)
    high = torch.where(there, times, -torch.inf).amax(1)
    length = high - low
    near = (free.center >= low - length) & (free.center <= high + length)
    # It rises to a length beyond the piece, or to its end if no opacity could be as high as there.
    end = torch.where(rises, high, low)
    beyond = _about(torch.where(rises, high + length, low - length), times, weights, logarithms)
    fixed = beyond.where(beyond.peak <= 1, _about(end, times, weights, logarithms))
    found = free.where(near & (free.peak <= 1 + CONSTANT), fixed)
    found = replace(found, peak=found.peak.clamp_max(1.0))
    return _level(times, there, opacities).where_better(found, times, there, opacities)


def _level(
    times: Float[Tensor, "p m"], there: Bool[Tensor, "p m"], opacities: Float[Tensor, "p m"]
) -> Windows:
    """Constant opacities, about the middle of the presence."""
    weights = there * (opacities**2 + FAINTEST)
    middle = (weights * times).sum(1) / weights.sum(1)
    level = (opacities * there).sum(1) / there.sum(1)
    return Windows(middle, torch.full_like(level, torch.inf), level)


def _of_parabolas(parabola: Polynomials) -> tuple[Windows, Bool[Tensor, " p"]]:
    """Windows of parabolas, NaN for those that open upwards; and where they rise at the origin."""
    constant, slope, bend = parabola.coefficients[..., 0].unbind(1)
    bend = torch.where(bend < 0, bend, torch.nan)
    vertex = -slope / (2 * bend)
    found = Windows(
        parabola.origin + parabola.unit * vertex,
        parabola.unit / (-bend).sqrt(),
        (constant - bend * vertex**2).exp(),
    )
    return found, slope > 0


def _about(
    center: Float[Tensor, " p"],
    times: Float[Tensor, "p m"],
    weights: Float[Tensor, "p m"],
    logarithms: Float[Tensor, "p m"],
) -> Windows:
    """The windows of least squares about given centres."""
    square = (times - center[:, None]) ** 2
    tiny = torch.finfo(weights.dtype).tiny
    total = weights.sum(1).clamp_min(tiny)
    mean, level = ((weights * values).sum(1) / total for values in (square, logarithms))
    apart = square - mean[:, None]
    together = (weights * apart * (logarithms - level[:, None])).sum(1)
    fall = (-together / (weights * apart**2).sum(1).clamp_min(tiny)).clamp_min(0.0)
    return Windows(center, fall.rsqrt(), (level + fall * mean).exp())
