"""What a rasterizer can do, and what a run needs of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from gsfw.core.cameras import CameraModel
from gsfw.core.errors import ConfigError


class Feature(Enum):
    """An optional ability of a rasterizer."""

    GRADIENT = "gradient"
    POSE_GRADIENT = "pose gradient"
    DISTORTION = "lens distortion"
    SH = "spherical harmonics"
    RAGGED_SH = "ragged spherical harmonics"
    COVARIANCES = "covariance form"
    EXTRA = "extra channels"
    DEPTH = "depth"
    ANTIALIAS = "antialias"
    SCREEN_GRADIENT = "screen gradient"
    ABSGRAD = "absgrad"
    CONTRIBUTION = "contribution"
    FLOAT64 = "float64"


class Determinism(Enum):
    """Whether drawing the same thing twice gives the same bits."""

    BITWISE = "bitwise"
    NONE = "none"


@dataclass(frozen=True)
class Needs:
    """The requirements of one component: of the rasterizer, and of the model."""

    camera_models: frozenset[CameraModel] = frozenset()
    features: frozenset[Feature] = frozenset()
    channels: int = 3
    profile: str = ""
    """Name of the numerics profile to draw with; empty for any."""
    densifiable: bool = False
    """Whether the model has to be a ``DensifiableModel``; checked when it is built."""

    def __or__(self, other: Needs) -> Needs:
        """Both needs at once."""
        return Needs(
            self.camera_models | other.camera_models,
            self.features | other.features,
            max(self.channels, other.channels),
            self.profile or other.profile,
            self.densifiable or other.densifiable,
        )


@dataclass(frozen=True)
class Capabilities:
    """What one rasterizer supports on this machine."""

    devices: frozenset[str] = frozenset()
    """Device types it runs on ("cpu", "cuda"), or would if it could run here."""
    camera_models: frozenset[CameraModel] = frozenset()
    features: frozenset[Feature] = frozenset()
    max_channels: int | None = None
    """Most colour channels it draws; ``None`` for no limit."""
    profile: str = ""
    """Name of the only numerics profile it draws with; empty when it draws with any."""
    determinism: Determinism = Determinism.NONE
    preference: int = 0
    """``rasterizer=auto`` takes the highest one that fits; the torch reference has 0."""
    unavailable: str = ""
    """Why it cannot run here, and what to do; empty when it can."""
    details: Mapping[str, str] = field(default_factory=dict)
    """What `gsfw doctor` shows besides, such as the instruction set."""

    def lacking(self, needs: Needs, device: str) -> list[str]:
        """Name each need that is not met; empty when all are."""
        if self.unavailable:
            return [self.unavailable]
        missing = [] if device in self.devices else [f"device {device!r}"]
        models = sorted(model.value for model in needs.camera_models - self.camera_models)
        missing += [f"camera model {model!r}" for model in models]
        features = sorted(feature.value for feature in needs.features - self.features)
        missing += [f"feature {feature!r}" for feature in features]
        if self.max_channels is not None and needs.channels > self.max_channels:
            missing.append(f"{needs.channels} channels (at most {self.max_channels})")
        if needs.profile and self.profile not in ("", needs.profile):
            missing.append(f"numerics {needs.profile!r} (it draws only with {self.profile!r})")
        return missing


def fitting(
    needs_by: Mapping[str, Needs], capabilities: Mapping[str, Capabilities], device: str
) -> list[str]:
    """Names of the rasterizers that meet every need, the preferred one first."""
    names = [
        name
        for name, able in capabilities.items()
        if not any(able.lacking(needs, device) for needs in [Needs(), *needs_by.values()])
    ]
    return sorted(names, key=lambda name: (-capabilities[name].preference, name))


def check_fit(
    name: str,
    needs_by: Mapping[str, Needs],
    capabilities: Mapping[str, Capabilities],
    device: str,
) -> None:
    """Check that rasterizer ``name`` meets every component's needs on ``device``.

    Raises:
        ConfigError: it does not; the message names who needs what, and who fits.
    """
    able = capabilities[name]
    others = fitting(needs_by, capabilities, device)
    advice = f"Rasterizers that fit here: {', '.join(others) or 'none'}."
    if able.unavailable:
        raise ConfigError(f"rasterizer {name!r} cannot run here: {able.unavailable}", advice)
    if device not in able.devices:
        runs_on = ", ".join(sorted(able.devices)) or "no device here"
        raise ConfigError(
            f"rasterizer {name!r} does not run on device {device!r} (it runs on: {runs_on}).",
            advice,
        )
    lines = [
        f"  {who} needs {need}"
        for who, needs in needs_by.items()
        for need in able.lacking(needs, device)
    ]
    if lines:
        raise ConfigError("\n".join([f"rasterizer {name!r} does not fit:", *lines]), advice)
