"""Discovery: the built-in plugins, then every installed one; a broken one is skipped."""

from __future__ import annotations

import difflib
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module, metadata
from types import ModuleType

import pluggy

from gsfw.core.errors import ConfigError
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
)

HOOKS = tuple(sorted(name for name in vars(hooks) if name.startswith(f"{PROJECT}_")))


@dataclass(frozen=True)
class BrokenPlugin:
    """A third-party plugin that did not load."""

    name: str
    distribution: str
    reason: str

    def __str__(self) -> str:
        return f"plugin {self.name!r} ({self.distribution}) is skipped: {self.reason}"


class PluginError(ConfigError):
    """Plugins contradict each other, or one implements a hook that does not exist."""


@dataclass(frozen=True)
class _Source:
    name: str
    distribution: str
    version: str


class Discovery:
    """What is installed: for each hook, the specs that plugins registered."""

    def __init__(self) -> None:
        self.broken: list[BrokenPlugin] = []
        self._manager = pluggy.PluginManager(PROJECT)
        self._manager.add_hookspecs(hooks)
        self._sources: dict[str, _Source] = {}

    def load_builtin(self) -> None:
        """Register gsfw's own plugins."""
        for name in BUILTIN:
            self.add(import_module(name), _Source(name, PROJECT, metadata.version(PROJECT)))

    def load_installed(self) -> None:
        """Register every plugin of the entry-point group ``gsfw``.

        ``GSFW_DISABLE_PLUGINS=1`` skips them all; ``GSFW_PLUGINS=a,b`` loads only these.
        """
        if os.environ.get("GSFW_DISABLE_PLUGINS") == "1":
            return
        only = os.environ.get("GSFW_PLUGINS")
        for entry in metadata.entry_points(group=PROJECT):
            if only is not None and entry.name not in only.split(","):
                continue
            distribution = entry.dist.name if entry.dist else "unknown distribution"
            version = entry.dist.version if entry.dist else ""
            try:
                self.add(entry.load(), _Source(entry.name, distribution, version))
            except PluginError:
                raise
            except Exception as error:
                reason = f"{type(error).__name__}: {error}"
                self.broken.append(BrokenPlugin(entry.name, distribution, reason))

    def add(self, plugin: ModuleType | object, source: _Source) -> None:
        """Register one plugin.

        Raises:
            PluginError: it implements a hook that does not exist.
        """
        for name in dir(plugin):
            is_hook = getattr(getattr(plugin, name, None), f"{PROJECT}_impl", None) is not None
            if is_hook and name not in HOOKS:
                near = difflib.get_close_matches(name, HOOKS, 1)
                hint = (
                    f" Did you mean {near[0]!r}?"
                    if near
                    else f" The hooks are: {', '.join(HOOKS)}."
                )
                raise PluginError(
                    f"plugin {source.name!r} ({source.distribution}): "
                    f"there is no hook {name!r}.{hint}"
                )
        self._sources[source.name] = source
        self._manager.register(plugin, source.name)

    def skip(self, broken: BrokenPlugin) -> None:
        """Remember a plugin that is left out, once."""
        if broken not in self.broken:
            self.broken.append(broken)

    def specs(self, hook: str) -> Iterator[Spec]:
        """Everything registered through ``hook``; a plugin that fails to answer is skipped."""
        for implementation in getattr(self._manager.hook, hook).get_hookimpls():
            source = self._sources[implementation.plugin_name]
            try:
                found = implementation.function()
                problem = _problem(found)
            except Exception as error:
                problem = f"raised {type(error).__name__}: {error}"
            if problem:
                self.skip(BrokenPlugin(source.name, source.distribution, f"{hook} {problem}"))
                continue
            for spec in found:
                yield replace(spec, distribution=source.distribution, version=source.version)


def _problem(found: object) -> str:
    """What is wrong with the answer of a hook; nothing if it is a list of specs."""
    if not isinstance(found, list | tuple):
        return f"returned {type(found).__name__}, expected a list of Spec"
    others = [type(item).__name__ for item in found if not isinstance(item, Spec)]
    return f"returned a list with {others[0]}, expected a list of Spec" if others else ""
