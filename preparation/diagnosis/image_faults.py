"""Image faults: causes in an image itself for having no place in the model, such as blur."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from gsfw.core.words import capitalized
from gsfw.preparation.diagnosis.unregistered import Reason, Unregistered
from gsfw.preparation.diagnosis.usual import Usual
from gsfw.preparation.features import FeatureReport
from gsfw.preparation.image_quality import EMPTY, SOFT
from gsfw.preparation.image_set import ImageSet

DARK, BRIGHT = 0.05, 0.95
"""Mean grey levels beyond which nothing is left to see: fox has 0.46 to 0.56; at a fiftieth of the
light it has 0.01 and not one feature."""
CLIPPED = 0.5
"""Part that is pure black or white and leaves too little; the shared photos have below 0.02."""
FEW = 100
"""Features: of two neighbouring photos of fox a third match; a blur of 4 pixels leaves 541 features
and 233 matches, one of 12 pixels 65 and none."""
FEW_SHARE = 0.1
"""Part of the usual number of features."""
FEW_TO_MATCH = 3 * FEW
"""Number of features below which too few matches are likely: at most a third of them match."""
SMALL = 800
"""Pixels of a longer edge below which photos were probably shrunk: photos of phones have 4,000."""
TEXTURE = "Include something with texture: step back, or put patterned things there."


@dataclass(frozen=True)
class ImageFaults:
    """Looks for causes in the images themselves."""

    images: ImageSet
    features: Mapping[str, FeatureReport]
    placed: frozenset[str]
    """Images of the largest model."""

    def first(self, name: str) -> Unregistered | None:
        """The first fault of an image that decodes."""
        checks = (self._exposure, self._plain, self._blur, self._few_features)
        return next((fault for check in checks if (fault := check(name))), None)

    def because(self, name: str, reason: Reason, found: str, advice: str) -> Unregistered:
        """The image with a reason; see ``Unregistered``."""
        return Unregistered(name, self.images.by_name[name].path, reason, found, advice)

    def feature_count(self, name: str) -> str:
        """The number of its features in words: "10 features were found where 2,000 are usual"."""
        count = self.features[name].count
        found = f"{count:,} feature{' was' if count == 1 else 's were'} found"
        return f"{found} where {self.usual.count:,.0f} are usual" if self.placed else found

    def more_features(self, name: str) -> str:
        """Advice on how to get more features."""
        header = self.images.by_name[name].header
        if max(header.width, header.height) >= SMALL:
            return TEXTURE
        size = f"{header.width}x{header.height} pixels"
        return f"Give the photos at their full size, if {size} is not all of it. {TEXTURE}"

    @cached_property
    def usual(self) -> Usual:
        """Typical figures of good images of this capture."""
        return Usual.of(self.features, self.placed)

    def _exposure(self, name: str) -> Unregistered | None:
        quality = self.features[name].quality
        # An object before black or white may well be clipped around it in all images.
        clipped = quality.clipped > CLIPPED and not (
            self.placed and quality.clipped < self.usual.quality.clipped + CLIPPED / 2
        )
        if not (clipped or quality.brightness < DARK or quality.brightness > BRIGHT):
            return None
        dark = quality.brightness < 0.5
        return self.because(
            name,
            "too dark" if dark else "over-exposed",
            f"Its mean brightness is {100 * quality.brightness:.0f} % and "
            f"{100 * quality.clipped:.0f} % of it pure black or white; {self.feature_count(name)}.",
            "Take such photos again with more light, or a longer exposure and a steady camera."
            if dark
            else "Take such photos again with a shorter exposure.",
        )

    def _plain(self, name: str) -> Unregistered | None:
        report, quality = self.features[name], self.features[name].quality
        if quality.contrast < EMPTY:
            found = f"It is of one colour; {self.feature_count(name)}."
            advice = "Look at the file: it should show something, or else be left out."
            return self.because(name, "empty", found, advice)
        if self.usual.quality.is_plain(quality) and self._has_few(report):
            return self.because(
                name,
                "few features",
                "It shows a plain surface, with "
                f"{_percent(quality.contrast / self.usual.quality.contrast)} of the usual "
                "contrast; "
                f"{self.feature_count(name)}.",
                TEXTURE,
            )
        return None

    def _blur(self, name: str) -> Unregistered | None:
        report, usual = self.features[name], self.usual.quality
        kind = report.blur.kind(usual)
        if kind == "sharp":
            return None
        sharpness = usual.sharpness_of(report.quality)
        found = (
            f"It has {_percent(usual.share_of_sharpness(report.quality))} of the usual sharpness"
        )
        if sharpness < SOFT and not usual.is_blurred(report.quality):
            found = f"It has hardly an edge (variance of its Laplacian {sharpness:.1g})"
        moved = kind == "motion blur"
        if moved:
            found += f", and least along {report.blur_direction or 0:.0f} degrees"
        return self.because(
            name,
            kind,
            f"{found}; {self.feature_count(name)}.",
            "Take such photos again with a shorter exposure, more light or a slower movement."
            if moved
            else "Take such photos again in focus.",
        )

    def _few_features(self, name: str) -> Unregistered | None:
        if not self._has_few(self.features[name]):
            return None
        return self.because(
            name,
            "few features",
            f"{capitalized(self.feature_count(name))}; at least {math.ceil(self._needed):,} are "
            "needed.",
            self.more_features(name),
        )

    @property
    def _needed(self) -> float:
        return max(float(FEW), FEW_SHARE * self.usual.count)

    def _has_few(self, report: FeatureReport) -> bool:
        return report.count < self._needed


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share >= 0.01 else "less than 1 %"
