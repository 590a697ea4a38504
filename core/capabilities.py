"""Capabilities of rasterizers, and the needs of a run that they are checked against."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING

from gsfw.core.errors import ConfigError

if TYPE_CHECKING:  # Configurations state needs before torch is imported.
    from gsfw.core.cameras import CameraModel

DEPTH_CHANNELS = 2
"""Channels of an expected depth image: the sum of weighted depths, and the sum of weights."""

SPLATTING = "splatting"
"""The rule of Kerbl et al. 2023: projected Gaussians are blended in the order of depth."""


class Feature(Enum):
    """An optional ability of a rasterizer."""

    GRADIENT = "gradient"
    """Gradients of the images for all tensors of the splats; every training needs it."""
    POSE_GRADIENT = "pose gradient"
    """Gradients for ``Cameras.world_to_camera``, too."""
    SH = "spherical harmonics"
    """``Splats.colors`` may be ``Sh``."""
    RAGGED_SH = "ragged spherical harmonics"
    """``Sh`` may have ``offsets``: each splat its own degree."""
    COVARIANCES = "covariance form"
    """``Splats.covariances`` in place of quats and scales."""
    EXTRA = "extra channels"
    """``Splats.extra``."""
    DEPTH = "depth"
    """``RenderSettings.depth``."""
    ANTIALIAS = "antialias"
    """``RenderSettings.antialias``."""
    SCREEN_GRADIENT = "screen gradient"
    """``Statistic.SCREEN_GRADIENT``."""
    ABSGRAD = "absgrad"
    """``Statistic.ABSGRAD``."""
    CONTRIBUTION = "contribution"
    """``Statistic.CONTRIBUTION``."""
    WEIGHTED_CONTRIBUTION = "contribution weighted by pixels"
    """``RenderSettings.contribution_weights``, and so ``StepContext.contributions``."""
    FLOAT64 = "float64"
    """Splats in double precision are rendered in it."""


class Determinism(Enum):
    """Guarantee of equal bits when the same inputs are rendered twice."""

    BITWISE = "bitwise"
    """The same bits, of images and gradients."""
    NONE = "none"
    """The last bits may differ."""


@dataclass(frozen=True)
class Needs:
    """The requirements of one component: of the rasterizer, and of the model.

    ``needs()`` of a configuration returns them; ``super().needs() | Needs(...)`` adds some.
    """

    camera_models: frozenset[CameraModel] = frozenset()
    """Camera models that it renders with."""
    features: frozenset[Feature] = frozenset()
    """Abilities that it uses."""
    channels: int = 3
    """Colour channels."""
    profile: str = ""
    """Name of the numerics profile to render with; empty for any."""
    extra_channels: int = 0
    """Channels of ``Splats.extra`` that this component adds."""
    densifiable: bool = False
    """True if the model has to be a ``DensifiableModel``; checked when it is built."""

    def __or__(self, other: Needs) -> Needs:
        """Both needs at once: the larger number of colour channels, the sum of the extra ones."""
        return Needs(
            self.camera_models | other.camera_models,
            self.features | other.features,
            max(self.channels, other.channels),
            self.profile or other.profile,
            self.extra_channels + other.extra_channels,
            self.densifiable or other.densifiable,
        )

    def channel_count(self) -> tuple[int, str]:
        """Channels rendered in one pass, and their description, such as "9 channels (6 extra)"."""
        depth = DEPTH_CHANNELS if Feature.DEPTH in self.features else 0
        parts = {"extra": self.extra_channels, "for depth": depth}
        total = self.channels + self.extra_channels + depth
        besides = ", ".join(f"{count} {name}" for name, count in parts.items() if count)
        return total, f"{total} channels" + (f" ({besides})" if besides else "")


@dataclass(frozen=True)
class Capabilities:
    """Abilities of one rasterizer on this machine."""

    devices: frozenset[str] = frozenset()
    """Device types it runs on ("cpu", "cuda"), or would if it could run here."""
    camera_models: frozenset[CameraModel] = frozenset()
    """Camera models that it renders."""
    features: frozenset[Feature] = frozenset()
    """Abilities that it has; one that is not here is never asked of it."""
    max_channels: int | None = None
    """Most channels in one pass, colour, extra and depth together; ``None`` for no limit."""
    profile: str = ""
    """Name of the only numerics profile it renders with; empty when it renders with any."""
    determinism: Determinism = Determinism.NONE
    """Guarantee of equal bits when the same inputs are rendered twice."""
    rule: str = SPLATTING
    """Name of the rule of its images. Backends of one rule make the same images, and are held to
    the reference; one with a rule of its own, such as rays or surfels, is not, and is taken only
    where it is named."""
    preference: int = 0
    """``rasterizer=auto`` takes the highest one of splatting's rule that fits; the torch reference
    has 0."""
    unavailable: str = ""
    """The cause why it cannot run here and the remedy; empty when it can run."""
    details: Mapping[str, str] = field(default_factory=dict)
    """Further lines of `gsfw doctor`, such as the instruction set."""

    def lacking(self, needs: Needs, device: str) -> list[str]:
        """Name each need that is not met; empty when all are."""
        if self.unavailable:
            return [self.unavailable]
        missing = [] if device in self.devices else [f"device {device!r}"]
        models = sorted(model.value for model in needs.camera_models - self.camera_models)
        missing += [f"camera model {model!r}" for model in models]
        wanted = needs.features | ({Feature.EXTRA} if needs.extra_channels else set())
        features = sorted(feature.value for feature in wanted - self.features)
        missing += [f"feature {feature!r}" for feature in features]
        count, channels = needs.channel_count()
        if self.max_channels is not None and count > self.max_channels:
            missing.append(f"{channels}, of which it renders at most {self.max_channels} at once")
        if needs.profile and self.profile not in ("", needs.profile):
            missing.append(f"numerics {needs.profile!r} (it renders only with {self.profile!r})")
        return missing


def _mismatches(able: Capabilities, needs_by: Mapping[str, Needs], device: str) -> list[str]:
    """Name each component and each of its needs that is not met; empty when all are."""
    found = [
        f"{who} needs {need}"
        for who, needs in needs_by.items()
        for need in able.lacking(needs, device)
    ]
    if not found:  # Channels add up: each component alone may fit, and all of them not.
        together = able.lacking(reduce(or_, needs_by.values(), Needs()), device)
        found = [f"all components together need {need}" for need in together]
    return found


def of_splatting(capabilities: Mapping[str, Capabilities]) -> dict[str, Capabilities]:
    """The rasterizers that may be chosen automatically: all make the images of splatting."""
    return {name: able for name, able in capabilities.items() if able.rule == SPLATTING}


def fitting(
    needs_by: Mapping[str, Needs], capabilities: Mapping[str, Capabilities], device: str
) -> list[str]:
    """Names of the rasterizers that meet every need, the preferred one first."""
    names = [name for name, able in capabilities.items() if not _mismatches(able, needs_by, device)]
    return sorted(names, key=lambda name: (-capabilities[name].preference, name))


def check_fit(
    name: str,
    needs_by: Mapping[str, Needs],
    capabilities: Mapping[str, Capabilities],
    device: str,
) -> None:
    """Check that rasterizer ``name`` meets every component's needs on ``device``.

    Raises:
        ConfigError: it does not; names the component, its unmet needs, and fitting rasterizers.
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
    found = _mismatches(able, needs_by, device)
    if found:
        raise ConfigError("\n  ".join([f"rasterizer {name!r} does not fit:", *found]), advice)
