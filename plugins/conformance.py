"""Conformance: checks that third-party code meets the contract of its slot.

A part is checked when it is loaded (``problem_of``) and when it is built (``check_built``), so
that a plugin for another version of gsfw is named before training starts.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from importlib import import_module
from typing import Any

from gsfw.plugins.keys import keys

CONTRACTS = {
    "method": ("gsfw.core.config:MethodConfig",),
    "rasterizer": ("gsfw.core.config:RasterizerConfig",),
    "datamanager": ("gsfw.core.config:DataManagerConfig",),
    "strategy": ("gsfw.core.config:StrategyConfig",),
    "sampler": ("gsfw.core.config:SamplerConfig",),
    "operators": ("gsfw.core.operators:Operators",),
    "exporter": ("gsfw.core.exchange:Exporter",),
    "importer": ("gsfw.core.exchange:Importer",),
    "metric": ("gsfw.core.metrics:Metric",),
    "callback": ("gsfw.core.config:CallbackConfig", "gsfw.core.callback:Callback"),
}
"""Base classes of each slot; a target derives from one of them."""

CORE = "gsfw.core."
"""Prefix of the modules with contracts."""


def problem_of(slot: str, target: object) -> str:
    """The misfit of a target and its slot, as a phrase; empty if it fits."""
    if slot == "command":
        return "" if _accepts(target, [[]]) else "its target is no function (arguments) -> int"
    contracts = [_class_at(place) for place in CONTRACTS[slot]]
    if not isinstance(target, type) or not issubclass(target, tuple(contracts)):
        names = " or ".join(kind.__name__ for kind in contracts)
        return f"its target {_name(target)} does not derive from {names}"
    problem = signature_problem(target)
    if not problem and is_dataclass(target):
        problem = _config_problem(target)
    return problem


def signature_problem(kind: type) -> str:
    """The violation of an inherited contract by a class, as a phrase; empty if there is none.

    A contract is any of its base classes in ``gsfw.core``: all abstract methods are implemented,
    and every method accepts the arguments of gsfw's calls.
    """
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    if missing:
        return f"{kind.__name__} lacks {', '.join(missing)}"
    for base, name, declared in _contract_methods(kind):
        own = getattr(kind, name)
        if getattr(own, "__func__", own) is getattr(declared, "__func__", declared):
            continue
        parameters = list(inspect.signature(declared).parameters.values())
        required = [item for item in parameters if item.default is item.empty]
        for asked in (required, parameters):
            if not callable(own) or not _accepts(own, asked, named=True):
                return (
                    f"{kind.__name__}.{name}{_signature(own)} has to take the arguments of "
                    f"{base.__name__}.{name}{_signature(declared)}"
                )
    return ""


def _contract_methods(kind: type) -> Iterator[tuple[type, str, Callable[..., Any]]]:
    """Public methods that a class inherits from its bases in ``gsfw.core``."""
    for base in kind.__mro__[1:]:
        if base.__module__.startswith(CORE):
            for name, item in vars(base).items():
                function = isinstance(item, staticmethod | classmethod) or inspect.isfunction(item)
                if function and (name == "__call__" or not name.startswith("_")):
                    yield base, name, getattr(base, name)


def _accepts(function: object, asked: list[Any], named: bool = False) -> bool:
    """True if a function accepts the arguments, or the arguments of these parameters."""
    try:
        signature = inspect.signature(function)  # type: ignore[arg-type]
    except (TypeError, ValueError):  # No function, or one without a signature.
        return callable(function)
    by_name = [item for item in asked if named and item.kind is item.KEYWORD_ONLY]
    in_order = [item for item in asked if item not in by_name]
    try:
        signature.bind(*in_order, **{item.name: item for item in by_name})
    except TypeError:
        return False
    return True


def _signature(function: object) -> str:
    """Names of the parameters: "(self, step, model)"."""
    try:
        parameters = inspect.signature(function).parameters  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return ""
    return f"({', '.join(parameters)})"


def _config_problem(kind: type) -> str:
    """The fault of a configuration: an unusable setting, or one without default or text."""
    known = {item.name for item in fields(kind)}
    for base in kind.__mro__:
        for name, annotation in inspect.get_annotations(base).items():
            if name not in known and "ClassVar" not in str(annotation):
                return (
                    f"{base.__name__} is no dataclass, so {name} is no setting: write @dataclass "
                    "above it"
                )
    for item in fields(kind):
        if item.init and item.default is MISSING and item.default_factory is MISSING:
            return f"setting {item.name} of {kind.__name__} has no default"
    from gsfw.plugins.values import describe

    try:
        for key in keys(kind()):
            describe(key.kind)
    except Exception as error:
        return f"the settings of {kind.__name__} cannot be read: {type(error).__name__}: {error}"
    return ""


def _class_at(place: str) -> type:
    module, _, name = place.partition(":")
    found: type = getattr(import_module(module), name)
    return found


def _name(target: object) -> str:
    return target.__name__ if isinstance(target, type) else repr(target)
