"""Usual: what pictures of a capture are like when nothing is wrong with them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from gsfw.datamanagers.picture_quality import BLURRED, PictureQuality, lit_sharpness
from gsfw.preparation.features import FeatureReport


@dataclass(frozen=True)
class Usual:
    """Typical figures of a capture's pictures."""

    count: float
    """Features."""
    brightness: float
    contrast: float
    clipped: float
    sharpness: float
    """As in light of the usual brightness."""

    @staticmethod
    def of(reports: Iterable[FeatureReport], quantile: float) -> Usual:
        """Quantiles, where more is better; medians of what has no better."""
        known = list(reports) or [FeatureReport(0, PictureQuality(0.0, 0.0, 0.0, 0.0), None, 1.0)]
        brightness = float(np.median([one.quality.brightness for one in known]))
        return Usual(
            count=float(np.quantile([one.count for one in known], quantile)),
            brightness=brightness,
            contrast=float(np.quantile([one.quality.contrast for one in known], quantile)),
            clipped=float(np.median([one.quality.clipped for one in known])),
            sharpness=float(
                np.quantile([_sharpness(one.quality, brightness) for one in known], quantile)
            ),
        )

    def sharpness_of(self, quality: PictureQuality) -> float:
        """Sharpness of a picture, as in light of the usual brightness."""
        return _sharpness(quality, self.brightness)

    def share_of_sharpness(self, quality: PictureQuality) -> float:
        """The same in parts of the usual sharpness."""
        return self.sharpness_of(quality) / max(self.sharpness, 1e-12)


def usual_of(features: Mapping[str, FeatureReport], placed: Iterable[str]) -> Usual:
    """Of pictures that were placed; of the better ones, where most may be bad as none was."""
    reports = [features[name] for name in placed if name in features]
    if reports:
        return Usual.of(reports, 0.5)
    return Usual.of([one for one in features.values() if not one.failure], 0.75)


def blurred_beside(features: Mapping[str, FeatureReport], placed: Iterable[str]) -> set[str]:
    """Pictures that were not placed, and are blurred beside those that were."""
    known = set(placed)
    usual = usual_of(features, known)
    return {
        name
        for name, report in features.items()
        if name not in known and usual.share_of_sharpness(report.quality) < BLURRED
    }


def _sharpness(quality: PictureQuality, brightness: float) -> float:
    return lit_sharpness(quality.sharpness, quality.brightness, brightness)
