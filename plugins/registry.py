"""Registry: the parts that can be chosen by name, slot by slot."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from gsfw.core.errors import ConfigError
from gsfw.core.words import suggestion
from gsfw.plugins.discovery import Discovery, PluginSource
from gsfw.plugins.other_tools import equivalent
from gsfw.plugins.plugin_path import FROM, VARIABLE, removal
from gsfw.plugins.skipped import HOOK, PLUGIN, BrokenPlugin, other_version
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
"""Hook of each slot."""


OTHER_RASTERIZER = (
    "\nA run can be resumed with another one: gsfw resume RUN rasterizer=cpu; if it is finished, "
    "with steps=N too."
)
"""The way out for a run whose rasterizer is missing: it can change, unlike method and strategy."""


class PartError(ConfigError):
    """A registered part cannot be used: its import fails, or it violates its contract."""

    def __init__(self, slot: str, spec: Spec, reason: str, advice: str) -> None:
        super().__init__(
            f"{slot} {spec.name!r} ({package(spec)}) cannot be used: {reason}.", advice
        )
        self.reason = reason


def registered_as(spec: Spec) -> str:
    """A method in messages, with the package of a third party: "method 'mine' (gsfw-mine 0.1)"."""
    name = f"method {spec.name!r}"
    return name if spec.distribution == PROJECT else f"{name} ({package(spec)})"


def package(spec: Spec) -> str:
    """The package of a part: "gsfw-dots 0.3"."""
    return f"{spec.distribution} {spec.version}".strip()


def origin(spec: Spec) -> str:
    """The package of a part in a sentence: "gsfw-dots 0.3", "the plugin at /home/me/x.py"."""
    if spec.distribution.startswith(FROM):
        return f"the plugin at {spec.distribution.removeprefix(FROM)}"
    return package(spec)


def how_to_get(packages: Sequence[str]) -> str:
    """The remedy for missing packages of a run, such as "gsfw-dots 0.3" or "from /home/me/x.py"."""
    places = [item.removeprefix(FROM) for item in packages if item.startswith(FROM)]
    if places:
        return f"Name the place where it is now: {VARIABLE}={os.pathsep.join(places)}"
    pins = " ".join(item.replace(" ", "==") for item in packages)
    return f"Install it, if you trust it: pip install {pins}"


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """Suggest a known name in a sentence with a leading space; empty if none is near.

    Words of other tools count as ours: "splatfacto" suggests "3dgs".
    """
    names = list(known)
    ours = equivalent(given, names)
    return f" Did you mean {ours!r}?" if ours else suggestion(given, names)


def what_is_missing(path: Path) -> str:
    """Describe a missing path: its last existing folder, and the nearest name there."""
    missing, parent = path, path.parent
    while not parent.is_dir():
        missing, parent = parent, parent.parent
    if missing.is_symlink():
        target = os.readlink(missing)
        return (
            f"{missing} is a link to {target}, which cannot be reached. Correct the link, or "
            "connect the disk of its target."
        )
    if missing.exists():
        return f"{missing} is a file, not a folder."
    near = did_you_mean(missing.name, [item.name for item in parent.iterdir()])
    return f"{parent.resolve()} contains no {missing.name!r}.{near}"


class Registry:
    """The parts that can be chosen by name; specs only, listing them imports nothing heavy."""

    def __init__(self, discovery: Discovery) -> None:
        self._discovery = discovery
        self._told = 0

    def slot(self, slot: str) -> Mapping[str, Spec]:
        """All parts of a slot, by name.

        Among several with one name, the built-in one wins, then that of GSFW_PLUGIN_PATH, then that
        of the first distribution by name; the others are skipped, and named in ``broken``.
        """
        found: dict[str, Spec] = {}
        for spec in self._discovery.specs(SLOTS[slot]):
            first = found.setdefault(spec.name, spec)
            if first is not spec:
                taken = f"this name is taken by {origin(first)}"
                advice = f"The first one is used; for the other, {removal(first.distribution)}."
                if first.distribution == PROJECT:
                    advice = "The built-in one is used; the other needs another name."
                self._leave_out(slot, spec, taken, advice)
        return dict(sorted(found.items()))

    def find(self, slot: str, name: str, packages: Sequence[str] = ()) -> Spec:
        """Find the spec with this name.

        Args:
            slot: such as "method".
            name: name on the command line, or in the settings of a run.
            packages: packages of the run's plugins, such as "gsfw-dots 0.3".

        Raises:
            ConfigError: there is none; suggests the nearest name, and lists the installed ones.
        """
        specs = self.slot(slot)
        if name in specs:
            return specs[name]
        way_out = OTHER_RASTERIZER if slot == "rasterizer" else ""
        self._check_packages(f"no {slot} {name!r} is installed here", packages, way_out)
        broken = "".join(f"\nnote: {plugin}" for plugin in self.broken[self._told :])
        raise ConfigError(
            f"no {slot} {name!r}.{did_you_mean(name, specs)}",
            f"Installed: {', '.join(specs) or 'none'}.{broken}",
        )

    def _check_packages(self, problem: str, packages: Sequence[str], way_out: str) -> None:
        """Name the packages of a run that are skipped or missing, as the cause of a problem.

        Args:
            problem: a phrase without a period.
            packages: packages of the run's plugins.
            way_out: what follows the remedy.

        Raises:
            ConfigError: there are some; says how to get them.
        """
        for plugin in self.broken:
            if plugin.kind in (PLUGIN, HOOK) and any(map(plugin.comes_from, packages)):
                raise ConfigError(f"{problem}: the {plugin.skipped}.", f"{plugin.advice}{way_out}")
        missing = [package for package in packages if package not in self.third_parties()]
        if missing:
            names = ", ".join(item.removeprefix(FROM) for item in missing)
            advice = f"{how_to_get(missing)}{way_out}"
            raise ConfigError(f"{problem}. The run was made with {names}.", advice)

    @property
    def broken(self) -> list[BrokenPlugin]:
        """Skipped plugins, and the causes."""
        return self._discovery.broken

    def tell_broken(self, tell: Callable[[str], None]) -> None:
        """Name each skipped plugin that was not named before."""
        for plugin in self.broken[self._told :]:
            tell(str(plugin))
        self._told = len(self.broken)

    def skip(self, slot: str, spec: Spec, error: Exception) -> None:
        """Record, once, that a failed part of a third party is skipped.

        Raises:
            Exception: ``error`` itself, if the part is gsfw's own: that is a bug.
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
        """Packages of the plugins: "gsfw-dots 0.3"."""
        return self._discovery.third_parties()

    def owner(self, module: str) -> PluginSource | None:
        """The third-party plugin that contains a module; ``None`` for any other module."""
        return self._discovery.owner(module)


@lru_cache(maxsize=1)
def installed() -> Registry:
    """The registry of this environment."""
    discovery = Discovery()
    discovery.load_builtin()
    discovery.load_third_parties()
    return Registry(discovery)
