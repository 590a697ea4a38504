"""Registry: what can be chosen by name, slot by slot."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from gsfw.core.errors import ConfigError
from gsfw.plugins.discovery import BrokenPlugin, Discovery, PluginSource, other_version
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


class PartError(ConfigError):
    """A registered part cannot be used: it does not import, or breaks its contract."""

    def __init__(self, slot: str, spec: Spec, reason: str, advice: str) -> None:
        super().__init__(
            f"{slot} {spec.name!r} ({package(spec)}) cannot be used: {reason}.", advice
        )
        self.reason = reason


def package(spec: Spec) -> str:
    """Who brings a part: "gsfw-dots 0.3"."""
    return f"{spec.distribution} {spec.version}".strip()


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

        Of several with one name, the built-in one is taken, or that of the first distribution by
        name; the others are left out, and named in ``broken``.
        """
        found: dict[str, Spec] = {}
        for spec in self._discovery.specs(SLOTS[slot]):
            first = found.setdefault(spec.name, spec)
            if first is not spec:
                taken = f"this name is taken by {package(first)}"
                advice = "Uninstall one of the two, or load only some with GSFW_PLUGINS=name,name."
                self._leave_out(slot, spec, taken, advice)
        return dict(sorted(found.items()))

    def find(self, slot: str, name: str, packages: Sequence[str] = ()) -> Spec:
        """The spec with this name.

        Args:
            slot: such as "method".
            name: as it is typed, or as a run has it.
            packages: that the plugins of this run came with, "gsfw-dots 0.3".

        Raises:
            ConfigError: there is none; suggests the nearest, and lists what is installed.
        """
        specs = self.slot(slot)
        if name in specs:
            return specs[name]
        missing = [package for package in packages if package not in self.third_parties()]
        if missing:
            raise ConfigError(
                f"no {slot} {name!r} is installed here. The run was made with "
                f"{', '.join(missing)}.",
                f"Install it, if you trust it: pip install "
                f"{' '.join(package.replace(' ', '==') for package in missing)}",
            )
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
        if isinstance(error, PartError):
            self._leave_out(slot, spec, error.reason, error.advice)
        else:
            reason = f"it failed with {type(error).__name__}: {error}"
            self._leave_out(slot, spec, reason, other_version(spec.distribution))

    def _leave_out(self, slot: str, spec: Spec, reason: str, advice: str) -> None:
        distribution, version = spec.distribution, spec.version
        self._discovery.skip(BrokenPlugin(spec.name, distribution, version, reason, advice, slot))

    def third_parties(self) -> list[str]:
        """The packages that have brought plugins: "gsfw-dots 0.3"."""
        return self._discovery.third_parties()

    def owner(self, module: str) -> PluginSource | None:
        """The third-party plugin whose code a module is; ``None`` for any other module."""
        return self._discovery.owner(module)


@lru_cache(maxsize=1)
def installed() -> Registry:
    """Everything installed in this environment."""
    discovery = Discovery()
    discovery.load_builtin()
    discovery.load_installed()
    return Registry(discovery)
