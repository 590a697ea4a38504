"""Registry: what can be chosen by name, slot by slot."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from gsfw.core.errors import ConfigError
from gsfw.plugins.discovery import BrokenPlugin, Discovery, PluginError
from gsfw.plugins.specs import PROJECT, Spec

SLOTS = MappingProxyType(
    {
        "method": "gsfw_methods",
        "rasterizer": "gsfw_rasterizers",
        "datamanager": "gsfw_datamanagers",
        "strategy": "gsfw_strategies",
        "sampler": "gsfw_samplers",
        "operators": "gsfw_operators",
        "exporter": "gsfw_exporters",
        "importer": "gsfw_importers",
        "metric": "gsfw_metrics",
        "callback": "gsfw_callbacks",
        "command": "gsfw_commands",
    }
)
"""Slot name -> the hook that fills it."""


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """A sentence that suggests the nearest known name, with a leading space; or nothing."""
    near = difflib.get_close_matches(given, list(known), 1, cutoff=0.6)
    return f" Did you mean {near[0]!r}?" if near else ""


def what_is_missing(path: Path) -> str:
    """A sentence about a path that is not there: where it ends, and the nearest name there is."""
    missing, parent = path, path.parent
    while not parent.is_dir():
        missing, parent = parent, parent.parent
    near = did_you_mean(missing.name, [item.name for item in parent.iterdir()])
    return f"{parent.resolve()} holds no {missing.name!r}.{near}"


class Registry:
    """What can be chosen by name; specs only, nothing heavy is imported to list them."""

    def __init__(self, discovery: Discovery) -> None:
        self._discovery = discovery

    def slot(self, slot: str) -> Mapping[str, Spec]:
        """Everything that fits into a slot, by name.

        Raises:
            PluginError: two plugins chose the same name; both distributions are named.
        """
        found: dict[str, Spec] = {}
        for spec in self._discovery.specs(SLOTS[slot]):
            if spec.name in found:
                raise PluginError(
                    f"{slot} {spec.name!r} is registered by both {found[spec.name].distribution!r} "
                    f"and {spec.distribution!r}.",
                    "Uninstall one of them, or load only some with GSFW_PLUGINS=name,name.",
                )
            found[spec.name] = spec
        return dict(sorted(found.items()))

    def find(self, slot: str, name: str) -> Spec:
        """The spec with this name.

        Raises:
            ConfigError: there is none; suggests the nearest, and lists what is installed.
        """
        specs = self.slot(slot)
        if name in specs:
            return specs[name]
        broken = "".join(f"\nnote: {plugin}" for plugin in self.broken)
        raise ConfigError(
            f"no {slot} {name!r}.{did_you_mean(name, specs)}",
            f"Installed: {', '.join(specs) or 'none'}.{broken}",
        )

    @property
    def broken(self) -> list[BrokenPlugin]:
        """Plugins that were skipped, and why."""
        return self._discovery.broken

    def skip(self, slot: str, spec: Spec, error: Exception) -> None:
        """Remember, once, that a part of a third party is left out because it failed.

        Raises:
            Exception: ``error`` itself, where the part is gsfw's own: that is a bug to be seen.
        """
        if spec.distribution == PROJECT:
            raise error
        cause = error.__cause__ or error
        reason = f"its {slot} failed with {type(cause).__name__}: {cause}"
        self._discovery.skip(BrokenPlugin(spec.name, spec.distribution, reason))


@lru_cache(maxsize=1)
def installed() -> Registry:
    """Everything installed in this environment."""
    discovery = Discovery()
    discovery.load_builtin()
    discovery.load_installed()
    return Registry(discovery)
