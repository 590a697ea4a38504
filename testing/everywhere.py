"""Promises of every kind of part: light registration, the contract's signatures, settings."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import is_dataclass
from functools import lru_cache
from importlib import import_module
from typing import Any

import yaml

from gsfw.core.config import replace_at
from gsfw.core.errors import UserError
from gsfw.plugins import hooks
from gsfw.plugins.conformance import problem_of, signature_problem
from gsfw.plugins.keys import Key, field_help, keys
from gsfw.plugins.registry import PartError
from gsfw.plugins.specs import PROJECT
from gsfw.plugins.values import as_text, parse, plain
from gsfw.testing.promise import NotApplicable, Promise, require
from gsfw.testing.subject import Subject
from gsfw.testing.trial import Builder

HEAVY = ("torch", "numpy", "scipy", "matplotlib", "PIL")
"""Modules that no registration imports: they take a second of every verb."""

LIGHT = """
import importlib, json, sys
sys.path[:] = json.loads(sys.argv[1])
for name in json.loads(sys.argv[2]):
    importlib.import_module(name)
print(json.dumps([name for name in json.loads(sys.argv[3]) if name in sys.modules]))
"""
"""Program that imports modules and prints the heavy ones among all that were imported."""

REQUIRES_API = "gsfw_requires_api"
"""The hook that returns the range of API versions."""

NUMBERS = ("-1", "0", "inf")
"""Values that some numeric settings cannot have."""


def _registration_is_light(subject: Subject) -> None:
    modules = subject.registrations
    if not modules:
        raise NotApplicable("the plugin is no module")
    heavy = _heavy_imports(modules)
    require(
        not heavy,
        f"importing {', '.join(modules)} also imports {', '.join(heavy)}.",
        "Name the target as text, 'package.module:Name', and import it in no module that this one "
        "imports.",
    )


@lru_cache
def _heavy_imports(modules: tuple[str, ...]) -> tuple[str, ...]:
    """Heavy modules that the import of others takes along, in a process of its own."""
    given = (json.dumps(sys.path), json.dumps(modules), json.dumps(HEAVY))
    done = subprocess.run(
        [sys.executable, "-c", LIGHT, *given], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    return tuple(json.loads(done.stdout.splitlines()[-1]))


def _fits_its_contract(subject: Subject) -> None:
    try:
        problem = problem_of(subject.slot, subject.target)
    except PartError as error:
        require(False, f"{error.reason}.", error.advice)
    problem = problem or _problem_when_built(subject)
    require(
        not problem,
        f"{problem}.",
        "Derive from the class of the contract in gsfw.api, and take its parameters.",
    )


def _problem_when_built(subject: Subject) -> str:
    """The misfit of the part that the default settings make, as a phrase.

    Empty if it fits, or cannot be made here: that is for other promises to judge.
    """
    kind: Any = subject.target
    if not (isinstance(kind, type) and is_dataclass(kind)):
        return ""
    try:
        made = Builder(subject).build(kind())
    except Exception:
        return ""
    parts = made if isinstance(made, list | tuple) else [made]
    return next(filter(None, (signature_problem(type(part)) for part in parts)), "")


def _settings_round_trip(subject: Subject) -> None:
    for key in settings_of(subject):
        text = yaml.safe_dump(plain(key.value))
        for form, given in (
            ("in config.yaml", yaml.safe_load(text)),
            ("on the command line", as_text(key.value)),
        ):
            try:
                found = parse(key.kind, given)
            except ValueError as error:
                found = error
            require(
                found == key.value,
                f"setting {key.name} is {key.value!r}, and becomes {found!r} {form}.",
                "Use bool, int, float, str, Path, Enum, Literal, or tuples of them as its type, "
                "and a default of this type.",
            )


def _settings_are_documented(subject: Subject) -> None:
    owners = {key.owner: key.name for key in settings_of(subject)}
    for owner in owners:
        try:
            inspect.getsource(owner)
        except (OSError, TypeError):
            raise NotApplicable("the source of the configuration is not available") from None
    explained = {owner: field_help(owner) for owner in owners}
    for key in settings_of(subject):
        text = explained[key.owner].get(key.name.rpartition(".")[2], "")
        require(
            text.endswith("."),
            f"the explanation of setting {key.name} is {text!r}.",
            'Write one sentence in """...""" below the field, with a period at its end.',
        )


def _bad_values_are_refused(subject: Subject) -> None:
    builder, settings = Builder(subject), [*settings_of(subject)]
    try:
        builder.build(subject.target())
    except Exception as error:
        raise NotApplicable(f"it cannot be built here with its defaults: {error}") from error
    for key in settings:
        if key.owner.__module__.startswith("gsfw.core.") or key.kind not in (int, float):
            continue
        for text in NUMBERS if key.kind is float else NUMBERS[:2]:
            try:
                builder.build(replace_at(subject.target(), key.name, parse(key.kind, text)))
            except UserError as error:
                named = key.name.rpartition(".")[2] in str(error)
                happened = f"the message for {key.name}={text} does not name the key: {error}"
                require(named, happened, "Begin the message with the key: 'KEY=VALUE: expected'.")
            except Exception as error:
                happened = f"{key.name}={text} ends in {type(error).__name__}: {error}."
                change = (
                    "Declare the range at the field: number(DEFAULT, at_least=..., below=...) of "
                    "gsfw.api; or raise ConfigError."
                )
                require(False, happened, change)


def settings_of(subject: Subject) -> Iterator[Key]:
    """The settings of a part.

    Raises:
        NotApplicable: it has none.
    """
    kind: Any = subject.target
    if not (isinstance(kind, type) and is_dataclass(kind)):
        raise NotApplicable(f"this {subject.slot} has no settings")
    return keys(kind())


def _states_its_api_range(subject: Subject) -> None:
    hook = getattr(hooks, REQUIRES_API, None)
    if hook is None or subject.spec.distribution == PROJECT or not subject.registrations:
        raise NotApplicable("it is part of gsfw, or no module")
    for name in subject.registrations:
        stated = getattr(import_module(name), REQUIRES_API, None)
        require(
            stated is not None and isinstance(stated(), str),
            f"{name} states no range of versions of gsfw.api.",
            f'Add a hook to it: @hookimpl def {REQUIRES_API}() -> str: return ">=1.0,<2".',
        )


EVERYWHERE = (
    Promise(
        "registration-is-light",
        "The module with the hooks imports neither torch nor other heavy packages.",
        _registration_is_light,
    ),
    Promise(
        "fits-its-contract",
        "The target can be imported, and all its methods take the arguments of gsfw's calls.",
        _fits_its_contract,
        is_required=True,
    ),
    Promise(
        "states-its-api-range",
        "The plugin states its range of gsfw.api versions. (Outside of this range it is not "
        "loaded.)",
        _states_its_api_range,
    ),
    Promise(
        "settings-round-trip",
        "Every setting keeps its value as text: in config.yaml and on the command line.",
        _settings_round_trip,
    ),
    Promise(
        "settings-are-documented",
        "Every setting has a sentence below its field, which --help shows.",
        _settings_are_documented,
    ),
    Promise(
        "bad-values-are-refused",
        "An invalid number is refused with a ConfigError that names the setting.",
        _bad_values_are_refused,
    ),
)
