"""ViewDependence: which degree of spherical harmonics the colours of matched points ask for."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from gsfw.core.maths.spherical_harmonics import num_coefficients, sh_basis
from gsfw.preparation.check.track_colors import TrackColors
from gsfw.preparation.check.track_exposure import TrackExposure

MIN_POINTS = 50
"""Fewer points say too little."""
MARGIN = 0.2
"""Part of the mean square error by which a degree has to be better than a lower one: with the
directions of fox's points shuffled 1.3 % of them still ask for one."""
WORTH = (2 / 255) ** 2
"""Least improvement of the error. Less is hardly seen, and a matte ball of 50 pixels, on which
patches are strongly curved, makes 1.2 grey levels."""
FEW = 0.1
"""Part of the points up to which a degree is left out for all."""
TINY = 1e-12
"""Mean square error of perfect images, far below that of 8 bits."""
DEGREES = (0, 1, 2)
"""Degree 3 has more coefficients than most points have images."""
ALONE = 0.98
"""Leverage from which on an observation decides a coefficient alone, and cannot be foretold."""
RANK = 1e-6
"""Directions span as many functions as the Gram matrix has eigenvalues above this part of the
largest: cameras on a circle around a point tell only 5 of 9 apart."""


@dataclass(frozen=True)
class ViewDependence:
    """View dependence of ``p`` points; deviations are in [0, 1]."""

    degrees: Int[np.ndarray, " p"]
    """The lowest that is enough for each."""
    errors: Float[np.ndarray, "p 3"]
    """Mean square error of degree 0, 1 and 2 at colours that the fit has not seen; infinite where a
    point is in too few images."""
    by_chance: float
    """Part of the points that ask for more than degree 0 after directions are shuffled."""
    exposed: Float[np.ndarray, " p"]
    """Standard deviation of each point's colours over its images."""
    deviation: Float[np.ndarray, " p"]
    """The same less what exposure explains."""
    misplaced: Float[np.ndarray, " p"]
    """Standard deviation that the point's reprojection error explains."""

    @staticmethod
    def of(colors: TrackColors) -> ViewDependence | None:
        """Measure it from colours in images; ``None`` for fewer than ``MIN_POINTS`` points."""
        if len(colors.rows) < MIN_POINTS:
            return None
        exposure = TrackExposure.of(colors.points, colors.views, colors.colors)
        points, directions, exposed, values, misplaced = (
            torch.from_numpy(array)
            for array in (
                colors.points,
                colors.directions,
                colors.colors,
                exposure.removed(colors.colors, colors.views),
                colors.misplaced,
            )
        )
        off = point_means(points, misplaced).numpy()
        errors = degree_errors(points, directions, values).numpy()
        shuffled = degree_errors(points, directions[_shuffle(points)], values).numpy()
        return ViewDependence(
            degrees=_degrees(errors, off),
            errors=errors,
            by_chance=float((_degrees(shuffled, off) > 0).mean()),
            exposed=_deviations(points, exposed),
            deviation=_deviations(points, values),
            misplaced=np.sqrt(off),
        )

    @property
    def shares(self) -> tuple[float, float, float]:
        """Parts of the points for which degree 0 is enough, degree 1 is, and neither is."""
        matte, first, more = np.bincount(self.degrees, minlength=len(DEGREES)) / len(self.degrees)
        return float(matte), float(first), float(more)

    @property
    def gains(self) -> tuple[float, float]:
        """Decibels of all points together by degree 1 where it is asked for, and by 2 beyond."""
        first, second = (
            10 * math.log10(max(lower, TINY) / max(higher, TINY))
            for lower, higher in pairwise(self._levels())
        )
        return first, second

    def _levels(self) -> list[float]:
        """Mean square error of all points if none may have more than degree 0, 1, 2."""
        used = (np.minimum(self.degrees, degree) for degree in DEGREES)
        return [float(np.take_along_axis(self.errors, own[:, None], 1).mean()) for own in used]

    @property
    def drifts(self) -> bool:
        """True if more than half of the usual variance is explained by exposure."""
        return bool(2 * np.median(self.deviation) ** 2 < np.median(self.exposed) ** 2)

    def advice(self) -> str:
        """The recommended setting, in a sentence."""
        (matte, _, more), levels = self.shares, self._levels()
        dependent = 1 - matte - self.by_chance
        if dependent <= FEW and levels[0] - levels[-1] <= WORTH:
            return "What it shows looks the same from every side: sh_degree=0 will lose little."
        if dependent < 1 - FEW:
            return "Some of it shines and some is matte: sh=adaptive spends numbers where they pay."
        if more <= FEW:
            return "Nearly all of it shines, but softly: sh_degree=1 will lose little."
        return "Nearly all of it shines: keep the usual sh_degree=3."

    def document(self) -> dict[str, Any]:
        """Plain data; deviations are medians over the points, in grey levels of 255."""
        matte, first, more = self.shares
        return {
            "points": len(self.degrees),
            "matte": round(matte, 3),
            "degree_1": round(first, 3),
            "degree_2": round(more, 3),
            "by_chance": round(self.by_chance, 3),
            "gain_db": [round(gain, 2) for gain in self.gains],
            "deviation": _grey_levels(self.exposed),
            "deviation_without_exposure": _grey_levels(self.deviation),
            "deviation_if_misplaced": _grey_levels(self.misplaced),
            "advice": self.advice(),
        }


def _grey_levels(values: Float[np.ndarray, " p"]) -> float:
    return round(255 * float(np.median(values)), 2)


def _deviations(points: Int[Tensor, " o"], values: Float[Tensor, "o 3"]) -> Float[np.ndarray, " p"]:
    """Standard deviations of each point's colours, over all channels."""
    counts = torch.bincount(points)
    off = values - point_means(points, values)[points]
    variance = point_means(points, off.square().mean(1)) * counts / (counts - 1)
    return variance.sqrt().numpy()


def _shuffle(points: Int[Tensor, " o"]) -> Int[Tensor, " o"]:
    """An order in which the observations of each point have changed places among themselves."""
    keys = np.random.default_rng(0).random(len(points))
    return torch.from_numpy(np.lexsort((keys, points.numpy())))


def _degrees(
    errors: Float[np.ndarray, "p 3"], misplaced: Float[np.ndarray, " p"]
) -> Int[np.ndarray, " p"]:
    """The lowest degree of each point that no higher one betters.

    What is gained over degree 0 has to be more than the variance of a misplaced point: one that is
    off in depth is off in another direction from each side, and its colour follows.
    """
    degrees = np.zeros(len(errors), np.int64)
    reached = errors[:, 0].copy()
    for degree in DEGREES[1:]:
        error = errors[:, degree]
        better = (error < (1 - MARGIN) * reached) & (reached - error > WORTH)
        better &= errors[:, 0] - error > misplaced
        degrees[better], reached[better] = degree, error[better]
    return degrees


def degree_errors(
    points: Int[Tensor, " o"], directions: Float[Tensor, "o 3"], values: Float[Tensor, "o 3"]
) -> Float[Tensor, "p 3"]:
    """Mean square error of every degree at every point.

    It is infinite where a point has too few observations for a degree.

    Args:
        points: of each observation; every number from 0 on is there.
        directions: unit vectors.
        values: colours.
    """
    basis = sh_basis(max(DEGREES), directions)
    fits = [basis[:, : num_coefficients(degree)] for degree in DEGREES]
    return torch.stack([_errors(points, fit, values) for fit in fits], dim=1)


def point_means(
    points: Int[Tensor, " o"], values: Float[Tensor, "o ..."]
) -> Float[Tensor, "p ..."]:
    """Means over the observations of each point."""
    counts = torch.bincount(points)
    sums = values.new_zeros(len(counts), *values.shape[1:]).index_add(0, points, values)
    return sums / counts.view(-1, *(1 for _ in values.shape[1:]))


def _errors(
    points: Int[Tensor, " o"], basis: Float[Tensor, "o k"], values: Float[Tensor, "o 3"]
) -> Float[Tensor, " p"]:
    """Errors of one degree."""
    gram = point_means(points, basis[:, :, None] * basis[:, None])
    inverse = torch.linalg.pinv(gram, rtol=RANK, hermitian=True)
    coefficients = inverse @ point_means(points, basis[:, :, None] * values[:, None])
    fitted = torch.einsum("ok,okd->od", basis, coefficients[points])
    leverage = torch.einsum("ok,okl,ol->o", basis, inverse[points], basis)
    leverage = leverage / torch.bincount(points)[points]
    errors = ((values - fitted) / (1.0 - leverage)[:, None]).square().mean(1)
    return point_means(points, errors.where(leverage < ALONE, torch.inf))
