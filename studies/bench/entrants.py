"""Entrants: the rasterizers that are measured, as they are named on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import torch

from gsfw.core.capabilities import Feature, Needs, check_fit
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

NEEDS = {"gsfw bench": Needs(features=frozenset({Feature.GRADIENT, Feature.SH}))}
"""Of a training step."""

STAGE_TIMES = "time_stages"
"""The setting of rasterizers that draw slower while they measure their stages."""


@dataclass(frozen=True)
class Candidate:
    """A rasterizer that is measured."""

    rasterizer: Rasterizer
    staged: Rasterizer
    """The one that measures its stages: the same where that costs nothing."""
    settings: RenderSettings
    """As in training, with the constants that it draws with."""


def choose(
    names: Sequence[str], device: str, registry: Registry
) -> tuple[torch.device, dict[str, Candidate]]:
    """The device, and the rasterizers to measure there by the name that each was given.

    Args:
        names: NAME, or NAME:KEY=VALUE:... with settings of that rasterizer; KEY alone means true.
        device: as in training.
        registry: everything installed.

    Raises:
        ConfigError: a rasterizer is not installed, cannot do what a training step needs, or has no
            such setting.
    """
    kinds = [name.partition(":")[0] for name in names]
    for kind in kinds:
        if kind != AUTO:
            registry.find("rasterizer", kind)
    named = next((kind for kind in kinds if kind != AUTO), AUTO)
    chosen, _ = choose_device(device, named, registry, NEEDS)
    place = torch.device(chosen.name if chosen else device)
    _, automatic = choose_device(place.type, AUTO, registry, NEEDS)
    assert automatic is not None, "it was asked for"
    candidates: dict[str, Candidate] = {}
    for given in names:
        name = given.replace(AUTO, automatic.name, 1) if given.startswith(AUTO) else given
        kind, _, settings = name.partition(":")
        check_fit(kind, NEEDS, rasterizer_capabilities(registry), place.type)
        config: RasterizerConfig = load("rasterizer", registry.find("rasterizer", kind))()
        candidates[name] = _candidate(_with_settings(config, name, settings), place)
    return place, candidates


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


def _candidate(config: RasterizerConfig, device: torch.device) -> Candidate:
    rasterizer = config.build(device)
    staged = rasterizer
    if STAGE_TIMES in {item.name for item in fields(config)}:
        watched = {STAGE_TIMES: True}
        staged = replace(config, **watched).build(device)
    profile = PROFILES.get(config.capabilities().profile, DEFAULT)
    settings = RenderSettings(validation=Validation.CHEAP, profile=profile)
    return Candidate(rasterizer, staged, settings)
