"""Settings: every value of a run, where it came from, and what was chosen for each slot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

from gsfw.core.config import AUTO, MethodConfig
from gsfw.core.errors import ConfigError
from gsfw.plugins.keys import SLOT_KEYS, current_key, keys
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry
from gsfw.plugins.specs import Spec
from gsfw.plugins.values import as_text, plain

COMMAND_LINE = "command line"
METHOD_DEFAULT = "method default"

CHOICE_KEYS = ("method", "preset", *SLOT_KEYS)
"""Keys that choose by name; all others are fields of a configuration."""


class Rank(IntEnum):
    """The order in which layers win: later ones over earlier ones."""

    DEFAULT_PRESET = 0
    PRESET = 1
    DATAMANAGER = 2
    """Recommended by the data manager."""
    STRATEGY = 3
    """Recommended by the strategy."""
    GIVEN = 4
    """Files and the command line, in the order in which they were given."""


@dataclass(frozen=True)
class Layer:
    """Values from one place; those of higher rank win, and of one rank the later ones."""

    source: str
    """Such as "command line", "preset fast", "config file a.yaml"."""
    values: Mapping[str, Any]
    """By dotted key: text as it is typed, or plain data."""
    given: frozenset[str] | None = None
    """Keys that someone chose, where the layer holds every value of a run; ``None`` for all."""
    rank: Rank = Rank.GIVEN
    packages: tuple[str, ...] = ()
    """The packages whose plugins the values are for: "gsfw-dots 0.3"."""

    def gives(self, key: str) -> bool:
        """Whether someone chose the value of ``key``."""
        return key in (self.values if self.given is None else self.given)

    def with_current_names(self, renamed: Mapping[str, str]) -> Layer:
        """The layer with settings under the names that they have now.

        Raises:
            ConfigError: a setting is there under its old and its new name.
        """
        names = {key: current_key(key, renamed) for key in self.values}
        if all(old == new for old, new in names.items()):
            return self
        values: dict[str, Any] = {}
        for old, new in names.items():
            if old != new and new in self.values:
                raise ConfigError(
                    f"{where(self.source)}{old} was renamed to {new}, and both are given.",
                    f"Leave out {old}.",
                )
            if new:
                values[new] = self.values[old]
        given = None if self.given is None else frozenset(names[key] for key in self.given)
        return replace(self, values=values, given=given)


@dataclass(frozen=True)
class Settings:
    """Every value of a run, resolved."""

    method: Spec
    config: MethodConfig
    """All slots are filled."""
    choices: Mapping[str, Spec]
    """What was chosen for each slot: strategy, rasterizer, datamanager, sampler."""
    sources: Mapping[str, str]
    """Where each value came from, by dotted key."""
    given: tuple[str, ...] = ()
    """Keys that someone chose: the others follow from these."""
    preset: str = ""
    """The preset that was chosen, if any."""
    notes: tuple[str, ...] = ()
    """Facts about the values that were given, for people: settings that have new names."""

    def flat(self) -> dict[str, Any]:
        """Every setting as plain data by dotted key, the choices first."""
        chosen = {slot: spec.name for slot, spec in self.choices.items()}
        values = {key.name: plain(key.value) for key in keys(self.config)}
        return {"method": self.method.name, **chosen, **values}


def resolve(registry: Registry, layers: Sequence[Layer]) -> Settings:
    """Settings from the method's defaults, a preset, what its parts recommend, and ``layers``.

    Every preset builds on the one named "default". That way what a method wants of a strategy holds
    whenever this strategy is used, even where the preset is made for another one.

    Raises:
        ConfigError: a key or name is unknown, or a value has the wrong type; says where.
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
    resolution.apply_values()
    resolution.choose_rasterizer()
    resolution.rescale(kind().steps)
    return resolution.settings()


def _check_names(registry: Registry, layers: Sequence[Layer]) -> None:
    """Refuse unknown choices before anything heavy is imported."""
    for slot in ("method", *SLOT_KEYS):
        named = [layer for layer in layers if slot in layer.values]
        name = as_text(named[-1].values[slot]) if named else AUTO
        if name != AUTO:
            registry.find(slot, name, named[-1].packages)


def last(layers: Sequence[Layer], key: str) -> tuple[str | None, str]:
    """The value of ``key`` that wins, as text, and its source."""
    for layer in reversed(layers):
        if key in layer.values:
            return as_text(layer.values[key]), layer.source
    return None, METHOD_DEFAULT


def where(source: str) -> str:
    """The beginning of a message about a value; what was just typed needs no place."""
    return "" if source == COMMAND_LINE else f"{source}: "
