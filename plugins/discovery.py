"""Discovery: loads the built-in and the installed plugins; a broken one has no effect on others."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module, metadata
from types import ModuleType

import pluggy

from gsfw.plugins import hooks
from gsfw.plugins.specs import PROJECT, Spec

BUILTIN = (
    "gsfw.plugins.builtin",
    "gsfw.callbacks",
    "gsfw.commands",
    "gsfw.datamanagers",
    "gsfw.formats",
    "gsfw.kernels",
    "gsfw.methods",
    "gsfw.rasterizers",
    "gsfw.samplers",
    "gsfw.strategies",
    "gsfw.viewer",
)

HOOKS = tuple(sorted(name for name in vars(hooks) if name.startswith(f"{PROJECT}_")))

_UNKNOWN_FIELD = re.compile(r"Spec\.__init__\(\) got an unexpected keyword argument '(\w+)'")


@dataclass(frozen=True)
class PluginSource:
    """A plugin: the origin of registrations."""

    name: str
    """Name of its entry point."""
    distribution: str
    version: str
    package: str = ""
    """Top-level module of the entry point; empty without one."""

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".strip()


@dataclass(frozen=True)
class BrokenPlugin:
    """A plugin of a third party that is skipped, completely or in part."""

    name: str
    distribution: str
    version: str
    reason: str
    """A phrase without a period."""
    advice: str
    """The remedy, a sentence."""
    kind: str = "plugin"
    """Kind of the failed object: plugin, or the slot of the part."""

    def __str__(self) -> str:
        package = f"{self.distribution} {self.version}".strip()
        return f"{self.kind} {self.name!r} ({package}) is skipped: {self.reason}. {self.advice}"


def other_version(distribution: str) -> str:
    """The remedy for a package and a gsfw that do not fit together."""
    return (
        f"This is {PROJECT} {metadata.version(PROJECT)}: install the version of {distribution} "
        f"that was made for it, or uninstall {distribution}."
    )


class Discovery:
    """Installed parts: for each hook, the specs that plugins registered."""

    def __init__(self) -> None:
        self.broken: list[BrokenPlugin] = []
        self._manager = pluggy.PluginManager(PROJECT)
        self._manager.add_hookspecs(hooks)
        self._sources: dict[str, PluginSource] = {}

    def load_builtin(self) -> None:
        """Register gsfw's own plugins."""
        version = metadata.version(PROJECT)
        for name in BUILTIN:
            self.add(import_module(name), PluginSource(name, PROJECT, version, PROJECT))

    def load_installed(self) -> None:
        """Register every plugin of the entry-point group ``gsfw``, by distribution and name.

        ``GSFW_DISABLE_PLUGINS=1`` skips them all; ``GSFW_PLUGINS=a,b`` loads only these.
        """
        if os.environ.get("GSFW_DISABLE_PLUGINS") == "1":
            return
        only = os.environ.get("GSFW_PLUGINS")
        found = []
        for entry in metadata.entry_points(group=PROJECT):
            distribution = entry.dist.name if entry.dist else "unknown distribution"
            version = entry.dist.version if entry.dist else ""
            package = entry.value.partition(":")[0].partition(".")[0]
            found.append((PluginSource(entry.name, distribution, version, package), entry))
        for source, entry in sorted(found, key=lambda item: (item[0].distribution, item[0].name)):
            if only is not None and entry.name not in only.split(","):
                continue
            try:
                self.add(entry.load(), source)
            except (Exception, SystemExit) as error:
                advice = f"Install what it needs, or uninstall {source.distribution}."
                self._skip(source, f"{type(error).__name__}: {error}", advice)

    def add(self, plugin: ModuleType | object, source: PluginSource) -> None:
        """Register one plugin; unknown hooks are ignored, and named in ``broken``."""
        self._manager.register(plugin, _key(source))
        self._sources[_key(source)] = source
        for name in dir(plugin):
            is_hook = getattr(getattr(plugin, name, None), f"{PROJECT}_impl", None) is not None
            if is_hook and name not in HOOKS:
                near = difflib.get_close_matches(name, HOOKS, 1, cutoff=0.8)
                hint = f" (did you mean {near[0]!r}?)" if near else ""
                self._skip(source, f"its hook {name!r} does not exist{hint}, the others are used")

    def skip(self, broken: BrokenPlugin) -> None:
        """Record, once, that a plugin or a part of one is skipped."""
        if broken not in self.broken:
            self.broken.append(broken)

    def _skip(self, source: PluginSource, reason: str, advice: str = "") -> None:
        """Skip a plugin of a third party.

        Raises:
            TypeError: the plugin is gsfw's own; that is a bug.
        """
        if source.distribution == PROJECT:
            raise TypeError(f"{source.name}: {reason}")
        name, version = source.distribution, source.version
        advice = advice or other_version(name)
        self.skip(BrokenPlugin(source.name, name, version, reason, advice))

    def remove(self, name: str) -> None:
        """Remove all plugins of this name."""
        for key, source in list(self._sources.items()):
            if source.name == name:
                del self._sources[key]
                self._manager.unregister(name=key)

    def specs(self, hook: str) -> Iterator[Spec]:
        """All specs of ``hook``, built-in plugins first, then by distribution.

        A plugin that raises is skipped.
        """
        implementations = {
            implementation.plugin_name: implementation
            for implementation in getattr(self._manager.hook, hook).get_hookimpls()
        }
        for key, source in self._sources.items():
            if key not in implementations:
                continue
            try:
                found = implementations[key].function()
                problem = _problem(found)
            except (Exception, SystemExit) as error:
                if source.distribution == PROJECT:
                    raise
                problem = _raised(error)
            if problem:
                self._skip(source, f"{hook} {problem}")
                continue
            for spec in found:
                yield replace(spec, distribution=source.distribution, version=source.version)

    def third_parties(self) -> list[str]:
        """The packages of all plugins that were registered, except gsfw: "gsfw-dots 0.3"."""
        sources = self._sources.values()
        return sorted({str(source) for source in sources if source.distribution != PROJECT})

    def owner(self, module: str) -> PluginSource | None:
        """The third-party plugin that contains a module; ``None`` for any other module."""
        package = module.partition(".")[0]
        for source in self._sources.values():
            if source.distribution != PROJECT and package in self._packages(source):
                return source
        return None

    def _packages(self, source: PluginSource) -> set[str]:
        """Top-level modules of a plugin: that of its entry point, and those of its targets."""
        targets = {
            spec.target.partition(".")[0].partition(":")[0]
            for hook in HOOKS
            for spec in self.specs(hook)
            if (spec.distribution, spec.version) == (source.distribution, source.version)
        }
        return ({source.package} | targets) - {"", PROJECT}


def _key(source: PluginSource) -> str:
    """Unique key: two distributions may have entry points of the same name."""
    return f"{source.distribution}:{source.name}"


def _raised(error: BaseException) -> str:
    unknown = _UNKNOWN_FIELD.search(str(error))
    if unknown:
        return f"registers a Spec with the field {unknown[1]!r}, which this version does not have"
    return f"raised {type(error).__name__}: {error}"


def _problem(found: object) -> str:
    """The fault of a hook's result; empty if it is a list of specs."""
    if not isinstance(found, list | tuple):
        return f"returned {type(found).__name__}, expected a list of Spec"
    for item in found:
        if not isinstance(item, Spec):
            return f"returned a list with {type(item).__name__}, expected a list of Spec"
        texts = (item.name, item.description, item.target, item.paper)
        if not all(isinstance(text, str) for text in texts):
            return f"registers {item.name!r} with a field that is no text"
        if not re.fullmatch(r"[\w.+-]+", item.name):
            return f"registers the name {item.name!r}, which cannot be typed as a value"
        if not re.fullmatch(r"[\w.]+:[\w.]+", item.target):
            return f"registers {item.name!r} with the target {item.target!r}, no 'module:Name'"
    return ""
