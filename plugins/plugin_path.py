"""Plugins that are not installed: the files and folders that GSFW_PLUGIN_PATH names."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from gsfw.core.files.toml_text import parsed_toml
from gsfw.plugins.specs import PROJECT

VARIABLE = "GSFW_PLUGIN_PATH"
"""Environment variable: files and folders, separated as in PATH (":", on Windows ";")."""

FROM = "from "
"""Prefix of a place that stands for the distribution of a plugin without one."""


@dataclass(frozen=True)
class PathPlugin:
    """A plugin of a file or a folder."""

    name: str
    """Name of its entry point, or of its module."""
    place: Path
    """The file or folder, absolute."""
    target: str
    """Module or object of the entry point: "package.module", or "module:object"."""
    is_tree: bool = False
    """True for a source tree with a pyproject.toml."""

    @property
    def distribution(self) -> str:
        """The place, in place of a distribution: "from /home/me/mine.py"."""
        return f"{FROM}{self.place}"

    @property
    def package(self) -> str:
        """Top-level module."""
        return self.target.partition(":")[0].partition(".")[0]

    def load(self) -> Any:  # noqa: ANN401 - a module or an object with hooks
        """Import the module; the modules of a source tree come before installed ones."""
        if self.is_tree:
            source = self.place / "src"
            _add_path(source if source.is_dir() else self.place, first=True)
            return metadata.EntryPoint(self.name, self.target, PROJECT).load()
        # The folder around may hold anything: it must not hide an installed module.
        _add_path(self.place.parent, first=False)
        return _imported(self.package, self.place)


def plugins_on_path(place: Path) -> list[PathPlugin]:
    """The plugins of a module's file, a package's folder, or a source tree with entry points.

    Raises:
        ValueError: it is none of these; says why, as a phrase without a period.
    """
    project = place / "pyproject.toml"
    if project.is_file():
        entries = _entry_points(project)
        return [PathPlugin(name, place, target, True) for name, target in entries.items()]
    is_module = place.suffix == ".py" and place.is_file()
    if not is_module and not (place / "__init__.py").is_file():
        raise ValueError(
            "it is no .py file, no package with __init__.py and no source tree with pyproject.toml"
            if place.exists()
            else "there is no such file or folder"
        )
    if not place.stem.isidentifier():
        raise ValueError(f"{place.stem!r} is no name of a module: letters, digits and underscores")
    return [PathPlugin(place.stem, place, place.stem)]


def places() -> list[Path]:
    """The files and folders of GSFW_PLUGIN_PATH, absolute, each once."""
    given = os.environ.get(VARIABLE, "").split(os.pathsep)
    return list(dict.fromkeys(Path(text).expanduser().resolve() for text in given if text))


def hook_modules(distribution: str) -> tuple[str, ...]:
    """The modules with the hooks of a plugin of GSFW_PLUGIN_PATH; empty for any other one."""
    if not distribution.startswith(FROM):
        return ()
    found = plugins_on_path(Path(distribution.removeprefix(FROM)))
    return tuple(sorted({plugin.target.partition(":")[0] for plugin in found}))


def removal(distribution: str) -> str:
    """The words for doing without a plugin: "uninstall gsfw-dots"."""
    if distribution.startswith(FROM):
        return f"take {distribution.removeprefix(FROM)} out of {VARIABLE}"
    return f"uninstall {distribution}"


def _entry_points(project: Path) -> Mapping[str, str]:
    """Name and target of the entry points for gsfw.

    Raises:
        ValueError: there are none, or the file is no TOML, or not of this form.
    """
    try:
        document: Any = parsed_toml(project.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"pyproject.toml cannot be read: {error}") from error
    names: list[str] = []
    for name in ("project", "entry-points", PROJECT):
        if name not in document:
            raise ValueError(f"pyproject.toml has no [project.entry-points.{PROJECT}]")
        names, document = [*names, name], document[name]
        if not isinstance(document, Mapping):
            raise ValueError(
                f"in pyproject.toml, {'.'.join(names)} is {document!r}: expected a table, "
                f"[project.entry-points.{PROJECT}]"
            )
    for name, target in document.items():
        if not isinstance(target, str):
            raise ValueError(
                f"in pyproject.toml, entry point {name!r} is {target!r}: expected a text such as "
                '"my_package.registration"'
            )
    return document


def _add_path(folder: Path, first: bool) -> None:
    """Let modules be imported from a folder, before all others or after them."""
    if str(folder) not in sys.path:
        sys.path.insert(0 if first else len(sys.path), str(folder))


def _imported(name: str, place: Path) -> Any:  # noqa: ANN401 - a module
    """Import a module from its file, or a package from its folder.

    Raises:
        ImportError: another module of this name is imported already.
    """
    file = place if place.is_file() else place / "__init__.py"
    known = sys.modules.get(name)
    if known is not None:
        if Path(getattr(known, "__file__", None) or "").resolve() == file:
            return known
        raise ImportError(f"another module is named {name!r}: rename this one")
    folders = None if place.is_file() else [str(place)]
    spec = importlib.util.spec_from_file_location(name, file, submodule_search_locations=folders)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
