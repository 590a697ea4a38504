"""Conformance: whether what a third party wrote keeps the contract of its slot.

Checked when a part is loaded (``problem_of``) and when it is built (``check_built``), so that a
plugin that was written for another version of gsfw is named before training starts.
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
"""The classes, one of which a slot's target derives from."""

CORE = "gsfw.core."
"""Modules whose classes are contracts begin with this."""


def problem_of(slot: str, target: object) -> str:
    """Why a target does not fit its slot, as a phrase; empty where it does."""
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
    """What of a class breaks the contracts that it derives from, as a phrase; empty for nothing.

    A contract is any of its base classes in ``gsfw.core``: all abstract methods are there, and
    every method takes the arguments that gsfw calls it with.
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
    """Public methods that the bases of a class in ``gsfw.core`` declare."""
    for base in kind.__mro__[1:]:
        if base.__module__.startswith(CORE):
            for name, item in vars(base).items():
                function = isinstance(item, staticmethod | classmethod) or inspect.isfunction(item)
                if function and (name == "__call__" or not name.startswith("_")):
                    yield base, name, getattr(base, name)


def _accepts(function: object, asked: list[Any], named: bool = False) -> bool:
    """Whether a function can be called with arguments, or with those of these parameters."""
    try:
        signature = inspect.signature(function)  # type: ignore[arg-type]
    except (TypeError, ValueError):  # No function, or one that does not tell.
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
    """What is wrong with a configuration: a setting that is none, has no default, or no text."""
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
