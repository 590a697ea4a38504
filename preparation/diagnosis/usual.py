"""Usual: typical features and quality of the images of a capture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsfw.preparation.features import FeatureReport
from gsfw.preparation.image_quality import UsualQuality


@dataclass(frozen=True)
class Usual:
    """Typical figures of images that a model can place."""

    count: float
    """Number of features."""
    quality: UsualQuality

    @staticmethod
    def of(features: Mapping[str, FeatureReport], placed: Iterable[str]) -> Usual:
        """Typical figures of the placed images; of the better ones where none is placed."""
        reports = [features[name] for name in placed if name in features]
        if reports:
            return _usual(reports, 0.5)
        return _usual([one for one in features.values() if not one.failure], 0.75)


def _usual(reports: Sequence[FeatureReport], quantile: float) -> Usual:
    return Usual(
        count=float(np.quantile([one.count for one in reports] or [0], quantile)),
        quality=UsualQuality.of([one.quality for one in reports], quantile),
    )


def blurred_beside(features: Mapping[str, FeatureReport], placed: Iterable[str]) -> set[str]:
    """Images that are not placed, and are blurred beside the placed ones."""
    known = set(placed)
    usual = Usual.of(features, known).quality
    return {
        name
        for name, report in features.items()
        if name not in known and usual.is_blurred(report.quality)
    }
