"""Loading: imports and checks the class of a registered name; errors name the package at fault."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, make_dataclass
from functools import lru_cache
from keyword import iskeyword
from typing import TYPE_CHECKING, Any, TypeVar

from gsfw.core.config import CallbackConfig, CallbackConfigs
from gsfw.core.errors import EndedBySignal
from gsfw.plugins.conformance import problem_of, signature_problem
from gsfw.plugins.registry import SLOTS, PartError, Registry, package
from gsfw.plugins.skipped import import_advice, other_version
from gsfw.plugins.specs import PROJECT, Spec

if TYPE_CHECKING:
    import torch

    from gsfw.core.callback import Callback
    from gsfw.core.metrics import Metric
    from gsfw.core.operators import Operators

Answer = TypeVar("Answer")


def load(slot: str, spec: Spec) -> Any:  # noqa: ANN401 - whatever the slot holds
    """Import the target of a spec, and check it against the contract of the slot.

    Raises:
        PartError: the import fails, or the target breaks the slot's contract; names the package.
    """
    try:
        target = spec.load()
    except EndedBySignal:
        raise
    except (Exception, SystemExit) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".")
        raise PartError(slot, spec, reason, import_advice(spec.distribution, error)) from error
    if spec.distribution != PROJECT:
        problem = problem_of(slot, target)
        if problem:
            raise PartError(slot, spec, problem, other_version(spec.distribution))
    return target


def load_all(slot: str, registry: Registry) -> dict[str, Any]:
    """Import all parts of a slot, by name; broken parts of third parties are skipped and recorded.

    Raises:
        ConfigError: a part of gsfw itself cannot be imported.
    """
    return ask_all(slot, registry, lambda target: target)


def ask_all(slot: str, registry: Registry, question: Callable[[Any], Answer]) -> dict[str, Answer]:
    """The results of ``question`` for all parts of a slot, by name.

    A part of a third party that cannot be loaded, or that raises, is skipped and recorded.

    Raises:
        Exception: a part of gsfw itself fails.
    """
    answers: dict[str, Answer] = {}
    for name, spec in registry.slot(slot).items():
        try:
            answers[name] = question(load(slot, spec))
        except Exception as error:
            registry.skip(slot, spec, error)
    return answers


def callback_configs(registry: Registry) -> CallbackConfigs:
    """The default settings of every callback, each in a field of its name."""
    kinds = {
        field_name(name): kind if issubclass(kind, CallbackConfig) else _without_settings(kind)
        for name, kind in load_all("callback", registry).items()
    }
    return _configs_class(tuple(kinds.items()))()


def make_callbacks(configs: CallbackConfigs, registry: Registry) -> list[Callback]:
    """Build every enabled callback; broken ones of third parties are skipped."""
    made: list[Callback] = []
    for name, spec in registry.slot("callback").items():
        config = getattr(configs, field_name(name), None)
        if config is None or not config.enabled:
            continue
        try:
            callback = config.build()
            check_built("callback", spec, callback)
        except Exception as error:
            registry.skip("callback", spec, error)
            continue
        callback.origin = f"callback {name!r} ({package(spec)})"
        made.append(callback)
    return made


def check_callbacks(configs: CallbackConfigs, registry: Registry) -> None:
    """Check, before any data is read, that every enabled callback can work on this machine.

    Raises:
        UserError: one cannot; says why.
    """
    for name in registry.slot("callback"):
        config = getattr(configs, field_name(name), None)
        if config is not None and config.enabled:
            config.check()


def field_name(name: str) -> str:
    """The name of a callback in keys: letters, digits and underscores."""
    word = re.sub(r"\W", "_", name)
    return word if word.isidentifier() and not iskeyword(word) else f"callback_{word}"


@lru_cache  # So that equal settings have one class.
def _configs_class(kinds: tuple[tuple[str, type[CallbackConfig]], ...]) -> type[CallbackConfigs]:
    members = [(name, kind, field(default_factory=kind)) for name, kind in kinds]
    return make_dataclass("Callbacks", members, bases=(CallbackConfigs,))


@lru_cache
def _without_settings(kind: type[Callback]) -> type[CallbackConfig]:
    @dataclass
    class Bare(CallbackConfig):
        def build(self) -> Callback:
            return kind()

    return Bare


def load_third_parties(registry: Registry) -> None:
    """Load all parts of third parties, so that ``registry.broken`` names all faults."""
    for slot in SLOTS:
        for spec in registry.slot(slot).values():
            if spec.distribution != PROJECT:
                try:
                    load(slot, spec)
                except PartError as error:
                    registry.skip(slot, spec, error)


def check_built(slot: str, spec: Spec, part: object, kind: type = object) -> None:
    """Check that a third party's part has its class, and accepts the calls of gsfw.

    Raises:
        PartError: it is of another class, is abstract, or a method has other parameters.
    """
    if spec.distribution != PROJECT:
        problem = signature_problem(type(part))
        if not isinstance(part, kind):
            problem = f"what it builds is {type(part).__name__}, expected a {kind.__name__}"
        if problem:
            raise PartError(slot, spec, problem, other_version(spec.distribution))


def make_metrics(registry: Registry, operators: Operators) -> dict[str, Metric]:
    """Every metric by name, the usual ones first; those of third parties are NaN if they fail."""
    from gsfw.core.metrics import USUAL_METRICS, CautiousMetric

    specs = registry.slot("metric")
    made: dict[str, Metric] = ask_all("metric", registry, lambda kind: kind(operators))
    return {
        name: metric
        if specs[name].distribution == PROJECT
        else CautiousMetric(metric, f"metric {name!r} ({package(specs[name])})")
        for name, metric in sorted(made.items(), key=lambda item: item[0] not in USUAL_METRICS)
    }


def choose_operators(registry: Registry, device: torch.device) -> Operators:
    """Choose the set of operators with the highest preference on ``device``."""
    willing = ask_all("operators", registry, lambda kind: (kind.preference(device), kind))
    able = {name: found for name, found in willing.items() if found[0] is not None}
    kind: type[Operators] = able[max(able, key=lambda name: (able[name][0], name))][1]
    return kind()
