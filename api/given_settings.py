"""Given settings: the settings that a program gives, as those of a command line."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsfw.commands.interface.arguments import expanded, full_key
from gsfw.core.errors import ConfigError

if TYPE_CHECKING:
    from gsfw.plugins.settings import Layer


def by_key(given: Mapping[str, object], settings: Mapping[str, object] | None) -> dict[str, Any]:
    """All settings by dotted key, without arguments that were left out.

    Args:
        given: arguments by name; ``None`` for those that were left out.
        settings: the others by dotted key, with hyphens or underscores.

    Raises:
        ConfigError: a setting is given twice.
    """
    found = {key: value for key, value in given.items() if value is not None}
    for name, value in (settings or {}).items():
        key = full_key(name.replace("-", "_"))
        if key in found:
            raise ConfigError(f"{key} is given twice.", f"Leave it out of settings: {name!r}.")
        found[key] = value
    return {
        key: expanded(str(it)) if isinstance(it, str | Path) else it for key, it in found.items()
    }


def layers_of(values: Mapping[str, object]) -> list[Layer]:
    """Layers of the settings, as those of a command line: a config file, then the others."""
    from gsfw.plugins.config_file import read_config
    from gsfw.plugins.settings import COMMAND_LINE, Layer

    others = {key: value for key, value in values.items() if key != "config"}
    files = [read_config(Path(str(values["config"])))] if "config" in values else []
    return [*files, Layer(COMMAND_LINE, others)]


def as_words(values: Mapping[str, object]) -> list[str]:
    """Settings as words of a command line."""
    from gsfw.plugins.values import as_text

    return [f"{key}={as_text(value)}" for key, value in values.items()]
