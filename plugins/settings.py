"""Settings: every value of a run, its source, and the choice of each slot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

from gsfw.core.config import AUTO, MethodConfig
from gsfw.core.dependencies import unmet_dependencies
from gsfw.core.errors import ConfigError
from gsfw.plugins.keys import SLOT_KEYS, current_key, current_value, keys
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry
from gsfw.plugins.specs import Spec
from gsfw.plugins.values import as_text, plain

COMMAND_LINE = "command line"
METHOD_DEFAULT = "method default"

CHOICE_KEYS = ("method", "preset", *SLOT_KEYS)
"""Keys of choices by name; all others are fields of a configuration."""

PLANNED_BY = ("minutes", "until")
"""Keys by which a run is planned, in place of a number of steps."""


class Rank(IntEnum):
    """Precedence of layers: later ones win."""

    DEFAULT_PRESET = 0
    PRESET = 1
    DATAMANAGER = 2
    """Recommended by the data manager."""
    STRATEGY = 3
    """Recommended by the strategy."""
    GIVEN = 4
    """Files and the command line, in the given order."""


@dataclass(frozen=True)
class Layer:
    """Values of one source; those of higher rank win, and of one rank the later ones."""

    source: str
    """Name of the source: "command line", "preset fast", "config file a.yaml"."""
    values: Mapping[str, Any]
    """Values by dotted key: text as on the command line, or plain data."""
    given: frozenset[str] | None = None
    """Keys that the user chose, if the layer holds all values of a run; ``None`` for all."""
    planned: frozenset[str] = frozenset()
    """Keys whose values a plan decided: they repeat a run, and another plan decides them anew."""
    rank: Rank = Rank.GIVEN
    packages: tuple[str, ...] = ()
    """Packages of the plugins of these values: "gsfw-dots 0.3"."""

    def gives(self, key: str) -> bool:
        """True if the user chose the value of ``key``."""
        return key in (self.values if self.given is None else self.given)

    def with_current_names(self, renamed: Mapping[str, str]) -> Layer:
        """Rename settings and values to their current names.

        Raises:
            ConfigError: a setting has values under its old and its new name.
        """
        names = {key: current_key(key, renamed) for key in self.values}
        values: dict[str, Any] = {}
        for old, new in names.items():
            if old != new and new in self.values:
                raise ConfigError(
                    f"{where(self.source)}{old} was renamed to {new}, and both are given.",
                    f"Leave out {old}.",
                )
            if new:
                values[new] = current_value(new, self.values[old], renamed)
        given = None if self.given is None else frozenset(names[key] for key in self.given)
        planned = frozenset(names[key] for key in self.planned)
        return replace(self, values=values, given=given, planned=planned)


@dataclass(frozen=True)
class Settings:
    """Every value of a run, resolved."""

    method: Spec
    config: MethodConfig
    """Configuration of the method, with all slots filled."""
    choices: Mapping[str, Spec]
    """Choice of each slot: strategy, rasterizer, datamanager, sampler."""
    sources: Mapping[str, str]
    """Source of each value, by dotted key."""
    given: tuple[str, ...] = ()
    """Keys that the user or a plan chose: the others follow from these."""
    planned: tuple[str, ...] = ()
    """Keys in ``given`` that a plan chose."""
    preset: str = ""
    """The chosen preset, if any."""
    notes: tuple[str, ...] = ()
    """Notes on the given values for the user: renamed settings."""

    def flat(self) -> dict[str, Any]:
        """All settings as plain data by dotted key, the choices first."""
        chosen = {slot: spec.name for slot, spec in self.choices.items()}
        values = {key.name: plain(key.value) for key in keys(self.config)}
        return {"method": self.method.name, **chosen, **values}


def resolve(registry: Registry, layers: Sequence[Layer]) -> Settings:
    """Resolve the method's defaults, a preset, the parts' recommendations, and ``layers``.

    Every preset builds on the one named "default". So a method's settings for a strategy hold
    for every use of this strategy, even if the preset is made for another one.

    Raises:
        ConfigError: a key or name is unknown, or a value has the wrong type; names the source.
        DataError: the data set is missing or of no known format.
    """
    name, _ = last(layers, "method")
    if name is None:
        installed = ", ".join(registry.slot("method"))
        raise ConfigError(
            "no method is chosen.", f"Add method=NAME; installed: {installed or 'none'}."
        )
    _check_names(registry, layers)
    spec = registry.find("method", name)
    kind: type[MethodConfig] = load("method", spec)
    from gsfw.plugins.resolving import Resolving

    resolution = Resolving(registry, spec, kind(), layers)
    resolution.choose("datamanager", Rank.DATAMANAGER)
    resolution.choose("strategy", Rank.STRATEGY)
    resolution.choose("sampler")
    resolution.share_steps()
    resolution.apply_values()
    resolution.choose_rasterizer()
    resolution.rescale(kind().steps)
    return _with_remarks(resolution.settings())


def _with_remarks(settings: Settings) -> Settings:
    """Note typed values that change nothing, as another setting switches off their use.

    They are not refused: commands that programs put together have them for good reasons. Values of
    files, presets and recommendations may be left over from another choice.
    """
    try:
        unmet = unmet_dependencies(settings.config)
    except (AttributeError, TypeError, ValueError) as error:  # A plugin's declaration stops no run.
        text = f"settings that change nothing are not noted, as a declaration is wrong: {error}"
        return replace(settings, notes=(*settings.notes, text))
    remarks = []
    for key in keys(settings.config):
        needed = next((item for item in unmet if item.covers(key.name)), None)
        if needed is not None and settings.sources[key.name] == COMMAND_LINE:
            value = as_text(plain(key.value))
            remarks.append(f"{key.name}={value} changes nothing without {needed.condition}.")
    return replace(settings, notes=(*settings.notes, *remarks))


def _check_names(registry: Registry, layers: Sequence[Layer]) -> None:
    """Refuse unknown choices before anything heavy is imported."""
    for slot in ("method", *SLOT_KEYS):
        named = [layer for layer in layers if slot in layer.values]
        name = as_text(named[-1].values[slot]) if named else AUTO
        if name != AUTO:
            registry.find(slot, name, named[-1].packages)


def last(layers: Sequence[Layer], key: str) -> tuple[str | None, str]:
    """The value of ``key`` with the highest precedence, as text, and its source."""
    for layer in reversed(layers):
        if key in layer.values:
            return as_text(layer.values[key]), layer.source
    return None, METHOD_DEFAULT


def where(source: str) -> str:
    """Beginning of a message about a value; empty for the command line."""
    return "" if source == COMMAND_LINE else f"{source}: "
