"""Entrants: the rasterizers that bench and stress measure, by their names, or all that run here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import torch

from gsfw.core.capabilities import SPLATTING, Capabilities, Needs, check_fit
from gsfw.core.config import AUTO, RasterizerConfig
from gsfw.core.errors import ConfigError
from gsfw.core.numerics import DEFAULT, PROFILES
from gsfw.core.ranges import check_ranges
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.plugins.automatic import choose_device, rasterizer_capabilities
from gsfw.plugins.keys import keys, suggest_key
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry
from gsfw.plugins.values import describe, parse

REFERENCE = "reference"
"""Name of the rasterizer that all others are compared with."""

STAGE_TIMES = "time_stages"
"""The setting of rasterizers that render slower while they measure their stages."""

ANOTHER_RULE = (
    "it renders by another rule than splatting's; name it to see how far apart the two are."
)


@dataclass(frozen=True)
class Entrant:
    """A rasterizer and its device."""

    name: str
    """As given: NAME or NAME:KEY=VALUE:..."""
    rasterizer: Rasterizer
    capabilities: Capabilities
    device: torch.device
    threads: tuple[int, ...] = (1, 1)
    """Numbers of threads for which the results must have equal bits; one for no comparison."""
    config: RasterizerConfig | None = None
    """Settings of the rasterizer; ``None`` for one that was built by hand."""

    @property
    def settings(self) -> RenderSettings:
        """Settings as in training, with the constants that this rasterizer renders with."""
        profile = PROFILES.get(self.capabilities.profile, DEFAULT)
        return RenderSettings(validation=Validation.CHEAP, profile=profile)

    def with_stages(self) -> Rasterizer:
        """The rasterizer with stage times: the same one where measuring them costs nothing."""
        if self.config is None or STAGE_TIMES not in {item.name for item in fields(self.config)}:
            return self.rasterizer
        watched = {STAGE_TIMES: True}
        return replace(self.config, **watched).build(self.device)


def entrant_of(name: str, registry: Registry, device: torch.device | None = None) -> Entrant:
    """Build a rasterizer.

    Args:
        name: NAME, or NAME:KEY=VALUE:... with settings of that rasterizer; KEY alone means true.
        registry: everything installed.
        device: where it renders; ``None`` for the CPU if it runs there, else for its own device.

    Raises:
        ConfigError: it is not installed, or has no such setting.
    """
    kind, _, settings = name.partition(":")
    config: RasterizerConfig = load("rasterizer", registry.find("rasterizer", kind))()
    config = _with_settings(config, name, settings)
    able = config.capabilities()
    device = device or torch.device(_usual_device(able))
    # CPU backends promise equal bits for any number of threads; other devices have their own.
    threads = (1, 2) if device.type == "cpu" else (1, 1)
    return Entrant(name, config.build(device), able, device, threads, config)


def choose_on_device(
    names: Sequence[str], device: str, registry: Registry, needs: dict[str, Needs]
) -> list[Entrant]:
    """Choose one device as training does, and build rasterizers for it.

    Args:
        names: as for ``entrant_of``; auto for the fastest that fits.
        device: auto, cpu, cuda or cuda:0.
        registry: everything installed.
        needs: required capabilities, by the name of their user.

    Raises:
        ConfigError: a rasterizer is not installed, does not fit, or has no such setting.
    """
    kinds = [name.partition(":")[0] for name in names]
    for kind in kinds:
        if kind != AUTO:
            registry.find("rasterizer", kind)
    named = next((kind for kind in kinds if kind != AUTO), AUTO)
    chosen, _ = choose_device(device, named, registry, needs)
    place = torch.device(chosen.name if chosen else device)
    _, automatic = choose_device(place.type, AUTO, registry, needs)
    assert automatic is not None, "it was asked for"
    found: dict[str, Entrant] = {}
    for given in names:
        name = given.replace(AUTO, automatic.name, 1) if given.startswith(AUTO) else given
        check_fit(name.partition(":")[0], needs, rasterizer_capabilities(registry), place.type)
        found[name] = entrant_of(name, registry, place)
    return list(found.values())


def choose_all(
    names: Sequence[str], registry: Registry, needs: dict[str, Needs]
) -> tuple[list[Entrant], Mapping[str, str]]:
    """Build rasterizers, each for its own device.

    Args:
        names: as for ``entrant_of``; empty for all that run here and render by splatting's rule.
        registry: everything installed.
        needs: as for ``choose_on_device``.

    Returns:
        The rasterizers; and, where no names are given, why others are left out, by name.

    Raises:
        ConfigError: one that is named is not installed, or does not run here.
    """
    able = rasterizer_capabilities(registry)
    for name in names:
        kind = name.partition(":")[0]
        registry.find("rasterizer", kind)
        check_fit(kind, needs, able, _usual_device(able[kind]))
    reasons = {} if names else {name: _why_not(item) for name, item in able.items()}
    chosen = names or [name for name, why in reasons.items() if not why]
    left_out = {name: why for name, why in reasons.items() if why}
    return [entrant_of(name, registry) for name in chosen], left_out


def _why_not(able: Capabilities) -> str:
    """The reason why a rasterizer takes part by name only; empty for all others."""
    return able.unavailable or (ANOTHER_RULE if able.rule != SPLATTING else "")


def _usual_device(able: Capabilities) -> str:
    return "cpu" if "cpu" in able.devices or not able.devices else min(able.devices)


def _with_settings(config: RasterizerConfig, name: str, text: str) -> RasterizerConfig:
    """The configuration with the settings of ``KEY=VALUE:KEY=VALUE``."""
    known = {key.name: key for key in keys(config)}
    for item in text.split(":") if text else ():
        key, given, value = item.partition("=")
        if key not in known:
            raise ConfigError(
                f"rasterizer={name}: there is no setting {key!r}.{suggest_key(key, known)}",
                f"Settings of this rasterizer: {', '.join(known) or 'none'}.",
            )
        try:
            parsed = parse(known[key].kind, value if given else "true")
        except ValueError:
            raise ConfigError(
                f"rasterizer={name}: {key}: expected {describe(known[key].kind)}, found {value!r}.",
                f"{key}: {known[key].help}",
            ) from None
        config = replace(config, **{key: parsed})
    check_ranges(config, f"rasterizer={name}: ")
    return config
