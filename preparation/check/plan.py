"""Plan: what would be trained, how much memory it takes, and the command to do it."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from gsfw.core.config import AUTO, MethodConfig
from gsfw.core.random_start import random_count
from gsfw.preparation.check.survey import Survey
from gsfw.preparation.check.time_findings import SEVERAL, cameras_at_times
from gsfw.preparation.check.viewpoints import Viewpoints
from gsfw.preparation.finding import Finding

LONG_SIDE, SHORT_ENOUGH = 1600, 800
"""Images are shrunk to at most 1600 pixels (as Kerbl et al. 2023's code does); to fit the cache,
not below 800."""
FLOATS = 59
"""Numbers of a Gaussian with spherical harmonics of degree 3: 3 + 4 + 3 + 1 + 48."""
COPIES = 4
"""Each with its gradient and Adam's two moments."""
MOST = 0.8
"""Part of the sampled images that has to agree on a background."""


@dataclass(frozen=True)
class Plan:
    """The training that fits a capture."""

    method: str
    methods: tuple[str, ...]
    """All methods that suit it, the suggested one first."""
    changes: Mapping[str, str]
    """Settings to add, in the order they are typed."""
    decoded_mb: float
    """All images at the size of the command, as 8-bit numbers; the CPU or the GPU keeps them."""
    cache_mb: int
    """Megabytes of decoded images that the run keeps."""
    gaussians: int
    """To start with."""

    @staticmethod
    def of(survey: Survey, findings: Iterable[Finding], config: MethodConfig, method: str) -> Plan:
        """The plan for a survey.

        Args:
            survey: of a data set that was opened with ``config``.
            findings: what was said about it.
            config: settings that were given, or their defaults.
            method: the one that was asked for; empty to choose.
        """
        masked = any(image.valid < 1 for image in survey.sample.images)
        suited = suited_methods(survey.viewpoints, masked)
        downscale = _downscale(survey, config)
        changes = {"downscale": f"{downscale:g}"} if downscale > 1 else {}
        background = plain_background(survey)
        if background:
            changes["background"] = background
        points = len(survey.scene.points)
        if not points and not survey.scene.has_alpha and survey.surface is not None:
            changes["random_region"] = "object"
        if any(finding.kind == "uneven exposure" for finding in findings):
            changes["exposure"] = "true"
        shrunk = (config.downscale / downscale) ** 2
        return Plan(
            method=method or suited[0],
            methods=suited,
            changes=changes,
            decoded_mb=_decoded_mb(survey) * shrunk,
            cache_mb=config.cache_mb,
            gaussians=points or _random_start(config, survey.scene.view_pixels * shrunk),
        )

    def megabytes(self, gaussians: int) -> float:
        """Memory of Gaussians with their gradients and optimizer state."""
        return gaussians * FLOATS * COPIES * 4 / 1e6

    def of_a_time(self) -> Plan:
        """The same for a run that ends in a time, which chooses the size of its images."""
        changes = {key: text for key, text in self.changes.items() if key != "downscale"}
        return replace(self, changes=changes)

    def command(self, given: Mapping[str, str]) -> str:
        """The command line, with the settings that were given and those to add."""
        pairs = (f"{key}={text}" for key, text in self.settings(given).items())
        return shlex.join(["gsfw", "train", *pairs])

    def settings(self, given: Mapping[str, str]) -> dict[str, str]:
        """Keys and values of that command, as they are typed."""
        return {"method": self.method, **given, **self.changes}


def _random_start(config: MethodConfig, view_pixels: float) -> int:
    """Gaussians of a random start, as given or by the size of the images."""
    given = getattr(config, "random_points", AUTO)
    return random_count(int(view_pixels)) if given == AUTO else int(given)


def plain_background(survey: Survey) -> str:
    """White or black where the borders of nearly all opaque images are; else empty."""
    images = survey.sample.images
    if survey.scene.has_alpha or not images:
        return ""
    for name in ("white", "black"):
        if sum(image.border == name for image in images) >= MOST * len(images):
            return name
    return ""


def suited_methods(viewpoints: Viewpoints, masked: bool = False) -> tuple[str, ...]:
    """The methods that suit a capture, the suggested one first.

    Args:
        viewpoints: all views.
        masked: True if masks leave pixels of images out.
    """
    if viewpoints.times is None:
        return ("3dgs",)
    if cameras_at_times(viewpoints) < SEVERAL:
        return ("4dgs", "4d-rotor", "spacetime")
    return ("spacetime", "4d-rotor", "4dgs", *(() if masked else ("dynamic3dgs",)))


def _decoded_mb(survey: Survey) -> float:
    channels = 4 if survey.scene.has_alpha else 3
    return float(survey.viewpoints.sizes.astype(float).prod(1).sum()) * channels / 1e6


def _downscale(survey: Survey, config: MethodConfig) -> float:
    """The factor that was given, doubled until images are of a sensible size."""
    downscale, megabytes = config.downscale, _decoded_mb(survey)
    longest = float(survey.viewpoints.sizes.max())
    while longest > LONG_SIDE or (megabytes > config.cache_mb and longest >= 2 * SHORT_ENOUGH):
        downscale, longest, megabytes = 2 * downscale, longest / 2, megabytes / 4
    return downscale
