"""Absent packages: modules that a script imports at its top, and that its run never calls."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType
from typing import Any, NoReturn

from gsfw.api import ConfigError


def leave_out(packages: Iterable[str]) -> None:
    """Let every import of these packages succeed, installed or not; their first call is an error.

    Raises:
        ConfigError: one of them is already imported.
    """
    for package in packages:
        if package in sys.modules:
            raise ConfigError(
                f"--without {package}: gsfw itself has imported it.",
                "Leave this option out; it is for packages that only the script imports.",
            )
        sys.meta_path.insert(0, _Finder(package))


class _Finder(MetaPathFinder, Loader):
    """Makes the modules of one package."""

    def __init__(self, package: str) -> None:
        self.package = package

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """The package and everything in it."""
        if fullname.partition(".")[0] != self.package:
            return None
        return spec_from_loader(fullname, self, is_package=True)

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """A module that has every name."""
        return _Module(spec.name)

    def exec_module(self, module: ModuleType) -> None:
        """Run nothing."""


class _Module(ModuleType):
    def __getattr__(self, name: str) -> _Name:
        return _named(f"{self.__name__}.{name}", name)


class _Name:
    """A name of an absent package: it can be imported, annotated and passed on, but not called."""

    _path = ""  # A copy is asked for its methods before it has its own.

    def __init__(self, path: str) -> None:
        self._path = path

    def __getattr__(self, name: str) -> _Name:
        return _named(f"{self._path}.{name}", name)

    def __call__(self, *_: Any, **__: Any) -> NoReturn:  # noqa: ANN401 - any call is an error
        self._refuse("calls")

    def __getitem__(self, key: object) -> _Name:
        """In annotations, such as ``NDArray[float]``."""
        return self

    def __or__(self, other: object) -> _Name:
        """In annotations, such as ``Tensor | None``."""
        return self

    __ror__ = __or__

    def __instancecheck__(self, instance: object) -> bool:
        """False: nothing can be made of an absent class."""
        return False

    __subclasscheck__ = __instancecheck__

    def __iter__(self) -> NoReturn:
        self._refuse("iterates over")

    def __mro_entries__(self, bases: tuple[object, ...]) -> NoReturn:
        self._refuse("derives a class from")

    def _refuse(self, verb: str) -> NoReturn:
        package = self._path.partition(".")[0]
        raise ConfigError(
            f"the script {verb} {self._path}, which --without {package} leaves out.",
            f"Install {package}, and run without this option.",
        )


def _named(path: str, name: str) -> _Name:
    """The name; Python's own attributes, such as __file__, are not there."""
    if name.startswith("__"):
        raise AttributeError(f"{path} is left out by --without")
    return _Name(path)
