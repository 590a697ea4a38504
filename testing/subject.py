"""Subject: the part that is checked, the registry that it is found in, and a workspace."""

from __future__ import annotations

import shutil
import tempfile
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module, metadata
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from gsfw.core.errors import ConfigError
from gsfw.plugins.discovery import BUILTIN, Discovery, PluginSource
from gsfw.plugins.loading import load
from gsfw.plugins.plugin_path import VARIABLE, hook_modules, places
from gsfw.plugins.registry import SLOTS, Registry, did_you_mean, installed, package
from gsfw.plugins.specs import PROJECT, Spec

Value = TypeVar("Value")


@dataclass(eq=False)
class Subject:
    """A registered part, and the values that its checks share."""

    slot: str
    spec: Spec
    registry: Registry
    data: Path | None = None
    """Data set for the checks; ``None`` for one that the kit makes."""
    settings: tuple[str, ...] = ()
    """Settings of every run of the kit, such as ("strategy.budget=100",)."""
    plugin: str = ""
    """Module with the hooks of a plugin that is not installed; empty for installed parts."""
    _known: dict[str, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        for item in self.settings:
            if not item.partition("=")[1]:
                raise ConfigError(
                    f"settings={item}: expected keys with values.",
                    "Write them with commas: settings=strategy.every=10,steps=50",
                )

    def __str__(self) -> str:
        return f"{self.slot} {self.name!r} ({package(self.spec)})"

    @property
    def name(self) -> str:
        """Name of the part."""
        return self.spec.name

    @cached_property
    def target(self) -> Any:  # noqa: ANN401 - whatever the slot holds
        """The registered class or function.

        Raises:
            PartError: it cannot be imported, or breaks the contract of its slot.
        """
        return load(self.slot, self.spec)

    @property
    def registrations(self) -> tuple[str, ...]:
        """The modules with the hooks of the part's package; empty if it has none."""
        if self.spec.distribution == PROJECT:
            return BUILTIN
        if of_path := hook_modules(self.spec.distribution):
            return of_path
        entries = [entry for entry in metadata.entry_points(group=PROJECT) if entry.dist]
        own = (e for e in entries if e.dist and e.dist.name == self.spec.distribution)
        found = tuple(sorted({entry.value.partition(":")[0] for entry in own}))
        return found or ((self.plugin,) if self.plugin else ())

    @cached_property
    def workspace(self) -> Path:
        """A folder for files of the checks; removed with the subject."""
        folder = tempfile.mkdtemp(prefix="gsfw-conformance-")
        # A TemporaryDirectory would warn when it is collected: an error in some tests.
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        return Path(folder)

    def once(self, name: str, make: Callable[[], Value]) -> Value:
        """A value that several checks use, made at its first use."""
        if name not in self._known:
            self._known[name] = make()
        found: Value = self._known[name]
        return found


def registry_with(plugin: ModuleType | object | str | None) -> Registry:
    """The installed parts, and those of a plugin that is not installed.

    Args:
        plugin: a module with hooks, its import name, or an object with hooks; ``None`` for none.

    Raises:
        ConfigError: there is no such module, or it cannot be imported.
    """
    if plugin is None:
        return installed()
    discovery = Discovery()
    discovery.load_builtin()
    discovery.load_third_parties()
    module = _module(plugin) if isinstance(plugin, str) else plugin
    if module is None:
        raise ConfigError(f"there is no module {plugin!r}.", _module_here(str(plugin)))
    name = module.__name__ if isinstance(module, ModuleType) else type(module).__name__
    top = name.partition(".")[0]
    try:
        discovery.add(module, PluginSource(name, top, "", top))
    except ValueError:  # Its package is installed, so that it is registered already.
        return installed()
    return Registry(discovery)


def find_subject(
    slot: str,
    name: str,
    *,
    plugin: ModuleType | object | str | None = None,
    data: Path | str | None = None,
    settings: Sequence[str] = (),
) -> Subject:
    """Find an installed part, or one of a plugin that is not installed.

    Args:
        slot: kind of the part, such as "method".
        name: registered name.
        plugin: a module with hooks, its import name, or an object with hooks; ``None`` for
            installed parts.
        data: data set for the checks; ``None`` for one that the kit makes.
        settings: settings of every run of the kit, as on the command line.

    Raises:
        ConfigError: there is no such slot or part; suggests the nearest name.
    """
    check_slot(slot)
    registry = registry_with(plugin)
    place = None if data is None else Path(data)
    spec = registry.find(slot, name)
    return Subject(slot, spec, registry, place, tuple(settings), _module_name(plugin))


def _module_name(plugin: ModuleType | object | str | None) -> str:
    """The import name of a plugin; empty if it is no module."""
    if isinstance(plugin, str):
        return plugin
    return plugin.__name__ if isinstance(plugin, ModuleType) else ""


def check_slot(slot: str) -> None:
    """Check the name of a kind.

    Raises:
        ConfigError: there is no such kind.
    """
    if slot not in SLOTS:
        raise ConfigError(
            f"there is no kind {slot!r} of parts.{did_you_mean(slot, SLOTS)}",
            f"Kinds: {', '.join(SLOTS)}.",
        )


def parts_of(
    name: str,
    *,
    plugin: ModuleType | object | str | None = None,
    data: Path | str | None = None,
    settings: Sequence[str] = (),
) -> list[Subject]:
    """All parts of a plugin.

    Args:
        name: an installed distribution, or the import name of a module with hooks, installed or
            not.
        plugin: as for ``find_subject``.
        data: as for ``find_subject``.
        settings: as for ``find_subject``.

    Raises:
        ConfigError: the plugin registers nothing, is skipped, or cannot be imported; says why.
    """
    registry = registry_with(plugin)
    place = None if data is None else Path(data)

    def found(*owners: str) -> list[Subject]:
        return [
            Subject(slot, spec, registry, place, tuple(settings), _module_name(plugin))
            for slot in SLOTS
            for spec in registry.slot(slot).values()
            if spec.distribution != PROJECT
            and {spec.distribution, spec.target.partition(":")[0].partition(".")[0]} & {*owners}
        ]

    parts = found(name)
    if not parts and plugin is None and _module(name):
        plugin, registry = name, registry_with(name)
        parts = found(name, name.partition(".")[0])
    if not parts:
        broken = " ".join(
            str(item) for item in registry.broken if name in (item.distribution, item.name)
        )
        third_parties = ", ".join(registry.third_parties()) or "none"
        raise ConfigError(
            broken or f"no part of a plugin {name!r} is registered.",
            _module_here(name) or f"Installed plugins: {third_parties}. See gsfw plugins.",
        )
    return parts


def subjects_named(
    name: str,
    slot: str = "",
    *,
    data: Path | str | None = None,
    settings: Sequence[str] = (),
) -> list[Subject]:
    """All parts of a name; of a plugin of this name if no part has it.

    Args:
        name: a registered name, an installed distribution, or a module with hooks.
        slot: kind of the part; empty for all.
        data: as for ``find_subject``.
        settings: as for ``find_subject``.

    Raises:
        ConfigError: there is no such part or plugin.
    """
    if slot:
        return [find_subject(slot, name, data=data, settings=settings)]
    registry = installed()
    slots = [kind for kind in SLOTS if name in registry.slot(kind)]
    if not slots:
        return parts_of(name, data=data, settings=settings)
    return [find_subject(kind, name, data=data, settings=settings) for kind in slots]


def _module(name: str) -> ModuleType | None:
    """Import a module by its name; ``None`` if there is none of this name.

    Raises:
        ConfigError: its import fails; the message has the error.
    """
    if not all(word.isidentifier() for word in name.split(".")):
        return None
    try:
        return import_module(name)
    except Exception as error:
        if isinstance(error, ModuleNotFoundError) and f"{name}.".startswith(f"{error.name}."):
            return None
        raise ConfigError(
            f"module {name!r} cannot be imported: {type(error).__name__}: {error}.",
            "Correct it, or install its dependencies.",
        ) from error


def _module_here(name: str) -> str:
    """The advice for a module of the current folder, which is not importable; empty without one."""
    for place in (Path(name), Path(f"{name}.py")):
        if place.resolve() in places():
            return ""  # It is named already, but is skipped or registers nothing.
        if (place.suffix == ".py" and place.is_file()) or (place / "__init__.py").is_file():
            command = f"{VARIABLE}={place} gsfw plugins check {place.stem}"
            return f"There is {place} in this folder; name it: {command}"
    return ""
