"""Discovery: loads the built-in and the installed plugins; a broken one has no effect on others."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib import import_module, metadata
from types import ModuleType
from typing import Any

import pluggy

from gsfw.core.errors import EndedBySignal
from gsfw.plugins import hooks
from gsfw.plugins.plugin_path import FROM, VARIABLE, PathPlugin, places, plugins_on_path
from gsfw.plugins.skipped import (
    HOOK,
    PLUGIN,
    BrokenPlugin,
    import_advice,
    other_range,
    other_version,
)
from gsfw.plugins.specs import PROJECT, Spec
from gsfw.plugins.versions import RangeError, check_range

BUILTIN = (
    "gsfw.plugins.builtin",
    "gsfw.callbacks",
    "gsfw.commands",
    "gsfw.datamanagers",
    "gsfw.formats",
    "gsfw.kernels",
    "gsfw.lod",
    "gsfw.methods",
    "gsfw.partition",
    "gsfw.rasterizers",
    "gsfw.samplers",
    "gsfw.strategies",
    "gsfw.viewer",
)

REQUIRES_API = "gsfw_requires_api"
"""The hook that returns a range of versions; all others return specs."""

HOOKS = tuple(sorted(name for name in vars(hooks) if name.startswith(f"{PROJECT}_")))
SPEC_HOOKS = tuple(name for name in HOOKS if name != REQUIRES_API)

_UNKNOWN_FIELD = re.compile(r"Spec\.__init__\(\) got an unexpected keyword argument '(\w+)'")
_WRONG_ARGUMENTS = re.compile(r"for hook '(\w+)'\s.*\sArgument\(s\) ", re.DOTALL)


@dataclass(frozen=True)
class PluginSource:
    """A plugin: the origin of registrations."""

    name: str
    """Name of its entry point, or of its module."""
    distribution: str
    version: str
    package: str = ""
    """Top-level module of the entry point; empty without one."""
    requires_api: str = ""
    """Range of API versions that it states; empty if it states none."""

    def __str__(self) -> str:
        return f"{self.distribution} {self.version}".strip()

    @property
    def noun(self) -> str:
        """The package for sentences, such as "gsfw-dots", or "/home/me/mine.py"."""
        return self.distribution.removeprefix(FROM)


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

    def load_third_parties(self) -> None:
        """Register the plugins of GSFW_PLUGIN_PATH, then the installed ones.

        ``GSFW_DISABLE_PLUGINS=1`` skips them all.
        """
        if os.environ.get("GSFW_DISABLE_PLUGINS") != "1":
            self.load_installed(self.load_path())

    def load_path(self) -> frozenset[str]:
        """Register every plugin of GSFW_PLUGIN_PATH, in order; return their top-level modules."""
        packages = set()
        for place in places():
            try:
                found = plugins_on_path(place)
            except ValueError as error:
                source = PluginSource(place.name, f"{FROM}{place}", "")
                self._skip(source, str(error), f"Correct {VARIABLE}.")
                continue
            for plugin in found:
                packages.add(plugin.package)
                source = PluginSource(plugin.name, plugin.distribution, "", plugin.package)
                self._load(plugin, source)
        return frozenset(packages)

    def load_installed(self, replaced: frozenset[str] = frozenset()) -> None:
        """Register every plugin of the entry-point group ``gsfw``, by distribution and name.

        ``GSFW_PLUGINS=a,b`` loads only these.

        Args:
            replaced: top-level modules of plugins of GSFW_PLUGIN_PATH, which replace installed
                ones: a package and its working copy.
        """
        only = os.environ.get("GSFW_PLUGINS")
        found = []
        for entry in metadata.entry_points(group=PROJECT):
            distribution = entry.dist.name if entry.dist else "unknown distribution"
            version = entry.dist.version if entry.dist else ""
            package = entry.value.partition(":")[0].partition(".")[0]
            if package not in replaced:
                found.append((PluginSource(entry.name, distribution, version, package), entry))
        for source, entry in sorted(found, key=lambda item: (item[0].distribution, item[0].name)):
            if only is None or source.name in only.split(","):
                self._load(entry, source)

    def _load(self, entry: metadata.EntryPoint | PathPlugin, source: PluginSource) -> None:
        """Import and register a plugin; skip it if that fails."""
        try:
            self.add(entry.load(), source)
        except EndedBySignal:
            raise
        except (Exception, SystemExit) as error:
            advice = import_advice(source.distribution, error)
            self._skip(source, f"{type(error).__name__}: {error}", advice)

    def add(self, plugin: ModuleType | object, source: PluginSource) -> None:
        """Register one plugin, unless it asks for another API version.

        Unknown hooks, and those without ``@hookimpl``, are ignored, and named in ``broken``, as is
        a plugin without hooks.
        """
        key = _key(source)
        try:
            self._manager.register(plugin, key)
        except pluggy.PluginValidationError as error:
            self._manager.unregister(name=key)
            wrong = _WRONG_ARGUMENTS.search(str(error))
            if wrong is None:
                raise
            self._skip(source, f"{wrong[1]} takes no arguments", f"Write def {wrong[1]}().")
            return
        if not self._manager.get_hookcallers(plugin) and not _unmarked_hooks(plugin):
            self._manager.unregister(name=key)
            self._skip(source, *_lack_of_hooks(plugin, source.package))
            return
        try:
            asked = self._asked_range(key)
        except RangeError as error:
            self._manager.unregister(name=key)
            self._skip(source, str(error), other_range(source.distribution, error))
            return
        self._sources[key] = replace(source, requires_api=asked)
        for name in dir(plugin):
            if _is_marked(plugin, name, "impl") and name not in HOOKS:
                near = difflib.get_close_matches(name, HOOKS, 1, cutoff=0.8)
                hint = f" (did you mean {near[0]!r}?)" if near else ""
                reason = f"there is no such hook{hint}, the others are used"
                self._skip(source, reason, hook=name)
        for name in _unmarked_hooks(plugin):
            self._skip(source, "it is not marked as a hook", f"Write @hookimpl above {name}.", name)

    def _asked_range(self, key: str) -> str:
        """The range of API versions that a plugin states; empty if it states none.

        Raises:
            RangeError: this gsfw is outside the range, or it cannot be read.
        """
        function = self._implementations(REQUIRES_API).get(key)
        if function is None:
            return ""
        try:
            asked = function()
        except EndedBySignal:
            raise
        except (Exception, SystemExit) as error:
            raise RangeError(f"its {REQUIRES_API} {_raised(error)}") from error
        return check_range(asked)

    def _implementations(self, hook: str) -> dict[str, Callable[[], Any]]:
        """The functions of a hook, by the key of their plugin."""
        found = getattr(self._manager.hook, hook).get_hookimpls()
        return {implementation.plugin_name: implementation.function for implementation in found}

    def skip(self, broken: BrokenPlugin) -> None:
        """Record, once, that a plugin or a part of one is skipped."""
        if broken not in self.broken:
            self.broken.append(broken)

    def _skip(self, source: PluginSource, reason: str, advice: str = "", hook: str = "") -> None:
        """Skip a plugin of a third party, or one of its hooks.

        Raises:
            TypeError: the plugin is gsfw's own; that is a bug.
        """
        if source.distribution == PROJECT:
            raise TypeError(f"{source.name}: {reason}")
        name, version = source.distribution, source.version
        advice = advice or other_version(name)
        reason = " ".join(reason.split()).rstrip(".")  # One line, whatever was raised.
        what, kind = (hook, HOOK) if hook else (source.name, PLUGIN)
        self.skip(BrokenPlugin(what, name, version, reason, advice, kind))

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
        implementations = self._implementations(hook)
        for key, source in self._sources.items():
            if key not in implementations:
                continue
            try:
                found = implementations[key]()
                problem = _problem(found)
            except EndedBySignal:
                raise
            except (Exception, SystemExit) as error:
                if source.distribution == PROJECT:
                    raise
                problem = _raised(error)
            if problem:
                self._skip(source, f"it {problem}", hook=hook)
                continue
            for spec in found:
                yield replace(
                    spec,
                    distribution=source.distribution,
                    version=source.version,
                    requires_api=source.requires_api,
                )

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
            for hook in SPEC_HOOKS
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


def _is_marked(plugin: ModuleType | object, name: str, marker: str) -> bool:
    return getattr(getattr(plugin, name, None), f"{PROJECT}_{marker}", None) is not None


def _unmarked_hooks(plugin: ModuleType | object) -> list[str]:
    """Functions with the name of a hook that lack the mark, and are never called."""
    return [
        name
        for name in HOOKS
        if callable(getattr(plugin, name, None))
        and not _is_marked(plugin, name, "impl")
        and not _is_marked(plugin, name, "spec")  # The specification itself, imported.
    ]


def _lack_of_hooks(plugin: ModuleType | object, package: str) -> tuple[str, str]:
    """Cause and remedy where a plugin has no hook."""
    module = getattr(plugin, "__name__", package)
    if isinstance(plugin, ModuleType) and plugin.__spec__ and not plugin.__spec__.has_location:
        # A folder of the project's name in a folder that Python searches before the package.
        folder = next(iter(getattr(plugin, "__path__", ())), "")
        return (
            f"the folder {folder}, which has no __init__.py, takes the place of its module "
            f"{module!r}",
            "Start Python in another folder, or rename this one. If it is the package itself, "
            "write its __init__.py, with the hooks.",
        )
    return f"its module {module!r} has no hook", f"Write one of {', '.join(SPEC_HOOKS)}."


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
