"""Help: all verbs and keys, from the registry and from the configuration classes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from gsfw.commands.interface.page import Row, option_table, paragraphs

if TYPE_CHECKING:
    from gsfw.commands.interface.arguments import Options
    from gsfw.plugins.keys import Key
    from gsfw.plugins.registry import Registry
    from gsfw.plugins.settings import Settings

COMMON = ("json", "debug")
"""Options of every verb, at the end of its help."""


def main_help(registry: Registry) -> str:
    """List the verbs, one line each, and two examples."""
    verbs = registry.slot("command")
    width = max(len(name) for name in verbs)
    return "\n".join(
        [
            "usage: gsfw VERB [key=value ...]",
            "",
            "Gaussian splatting, static and dynamic.",
            "",
            *(f"  {name:{width}}  {spec.description}" for name, spec in verbs.items()),
            "",
            "examples:",
            "  gsfw train method=3dgs",
            "  gsfw train method=3dgs data=DIR strategy=mcmc steps=7000 out=runs/first",
            "",
            "More on a verb: gsfw VERB --help. Version: gsfw --version.",
        ]
    )


def options_help(verb: str, kind: type[Options]) -> str:
    """Usage, words, keys and examples of a verb."""
    from gsfw.plugins.keys import class_help, field_help, keys

    explained = field_help(kind)
    words = [item for item in fields(kind) if "word" in item.metadata]
    make: Any = kind
    blank = make(**{item.name: "" for item in words})
    rows = [(item.metadata["word"], "", explained[item.name]) for item in words]
    options = [key for key in keys(blank) if key.name not in {item.name for item in words}]
    options.sort(key=lambda key: key.name in COMMON)
    usage = " ".join(["usage: gsfw", verb, *(item.metadata["word"] for item in words)])
    return "\n".join(
        [
            f"{usage} [key=value ...]",
            "",
            paragraphs(class_help(kind)),
            "",
            option_table([*rows, *map(option_row, options)]),
            *_examples(kind.examples),
        ]
    )


def settings_help(settings: Settings, registry: Registry, problem: str) -> str:
    """All keys of a method with the chosen parts, in groups, and the values of the run.

    Args:
        settings: of the run.
        registry: what is installed.
        problem: what is wrong with the given settings, where ``settings`` are not those; empty for
            nothing.
    """
    from gsfw.plugins.keys import SLOT_KEYS, keys
    from gsfw.plugins.resolving import preset_names

    method = settings.method
    choices = [
        (f"{slot}={settings.choices[slot].name}", "name", ", ".join(registry.slot(slot)))
        for slot in SLOT_KEYS
    ]
    presets = ", ".join(preset_names(settings.config))
    run = [
        ("config=FILE", "path", "Settings of a file, such as a run's config.yaml; repeatable."),
        ("preset=default", "name", f"Settings that go together: {presets}."),
    ]
    groups: dict[str, list[Row]] = {"parts": choices, "": run}
    callbacks: list[Row] = []
    for key in keys(settings.config):
        group = key.name.rpartition(".")[0]
        rows = callbacks if group.startswith("callbacks.") else groups.setdefault(group, [])
        rows.append(option_row(key))
    groups["callbacks"] = callbacks
    every = [row for rows in groups.values() for row in rows]
    lines = [
        f"usage: gsfw train method={method.name} [key=value ...]",
        "",
        paragraphs(f"{method.description}{f' ({method.paper})' if method.paper else ''}"),
        "",
        paragraphs(_whose_values(settings, problem)),
    ]
    for group, rows in groups.items():
        part = settings.choices.get(group)
        title = f"{group} {part.name}" if part else group or "run"
        lines += ["", option_table(rows, title, every)]
    return "\n".join(lines)


def _whose_values(settings: Settings, problem: str) -> str:
    """A sentence on the run that has the printed values."""
    if problem:
        return f"Values without the given settings, which are wrong: {problem}"
    data = f"data={settings.config.data}" if settings.config.data else "the built-in scene"
    return f"Values of a run on {data} with the given settings (gsfw config show names sources):"


def option_row(key: Key) -> Row:
    """The row of an option in a table of help: KEY=VALUE, type, meaning."""
    from gsfw.plugins.values import as_text, describe

    return f"{key.name}={as_text(key.value)}", describe(key.kind).removeprefix("a "), key.help


def _examples(lines: Sequence[str]) -> Iterable[str]:
    return ["", "examples:", *(f"  {line}" for line in lines)] if lines else []
