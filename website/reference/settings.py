"""The pages of settings: every key of every part, with type, default, range and meaning."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any

from gsfw.core.ranges import RANGE
from gsfw.core.step_settings import step_settings
from gsfw.core.words import capitalized
from gsfw.plugins.exporters import PREFIX
from gsfw.plugins.keys import SLOT_KEYS, Key, keys
from gsfw.plugins.loading import callback_configs, load_all
from gsfw.plugins.registry import Registry
from gsfw.plugins.specs import Spec
from gsfw.plugins.values import as_text, describe
from reference.markdown import code, prose, table

Row = tuple[str, ...]

HEADER = ["key", "type", "default", "range", "meaning"]

PAGES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "strategy": (
            "Strategies",
            "`strategy=NAME` decides which Gaussians are added and removed.",
        ),
        "rasterizer": (
            "Rasterizers",
            "`rasterizer=NAME` renders the Gaussians, and their gradients.",
        ),
        "datamanager": (
            "Data managers",
            "`datamanager=NAME` reads the data set. `auto` finds the format of `data=` by itself.",
        ),
        "sampler": ("Samplers", "`sampler=NAME` chooses the training views of each step."),
    }
)
"""Title and introduction of the page of each slot."""

PRESETS_OF_ALL = (
    "Settings that go together: those on the page of the method, and for every method `paper`, the "
    "steps of its paper without the cooldown of the rates."
)
"""Meaning of the key preset."""

FORMATS = "formats"
"""Name of the page of exporters."""

PARTS = ("exporter", "importer", "metric", "operators")
"""Slots whose parts are chosen by no setting."""


def settings_pages(registry: Registry) -> Iterator[tuple[str, str]]:
    """Names and texts of all pages; a method's page has the settings that only it has."""
    common, own = _methods(registry)
    yield "index", _index(registry)
    yield "run", _run_page(common)
    for name, (spec, found) in own.items():
        yield f"method-{name}", _method_page(spec, found)
    for slot, (title, introduction) in PAGES.items():
        yield slot, _slot_page(slot, title, introduction, registry)
    yield "callbacks", _callbacks_page(registry)
    yield FORMATS, _formats_page(registry)


def _index(registry: Registry) -> str:
    lines = [
        "# Settings",
        "",
        "Every setting is `key=value` on the command line, or a line of a file for `config=FILE`.",
        "`gsfw train method=NAME --help` prints those of a run with its values, `gsfw config show`",
        "where each value came from. `steps=N` rescales settings of the type *steps*.",
        "",
        "* [Settings of every run](run.md)",
        *(f"* [Method {name}](method-{name}.md)" for name in registry.slot("method")),
        *(f"* [{title}]({slot}.md)" for slot, (title, _) in PAGES.items()),
        "* [Callbacks](callbacks.md)",
        f"* [Formats of files]({FORMATS}.md)",
        "",
        "## Parts",
        "",
        "What is built in, by slot; `gsfw plugins` lists what is installed.",
    ]
    for slot in ("method", *PAGES, *PARTS, "callback"):
        rows = [[code(name), prose(_described(spec))] for name, spec in registry.slot(slot).items()]
        lines += ["", f"### {slot}", "", table(["name", "description"], rows)]
    return "\n".join(lines)


def _described(spec: Spec) -> str:
    return f"{spec.description} ({spec.paper})" if spec.paper else spec.description


def _sentence(spec: Spec) -> str:
    return f"{capitalized(prose(_described(spec)))}."


def _methods(registry: Registry) -> tuple[list[Row], dict[str, tuple[Spec, list[Row]]]]:
    """The settings that all methods share, and those of each that differ from them."""
    specs = registry.slot("method")
    without_parts: Any = dict.fromkeys(SLOT_KEYS)
    found = {
        name: list(_rows(replace(kind(), **without_parts)))
        for name, kind in load_all("method", registry).items()
    }
    first, *others = found.values()
    common = [row for row in first if all(row in other for other in others)]
    return common, {
        name: (specs[name], [row for row in rows if row not in common])
        for name, rows in found.items()
    }


def _rows(config: object, prefix: str = "") -> Iterator[Row]:
    """A row for each setting of a configuration."""
    counted = step_settings(config, prefix)
    for key in keys(config, prefix):
        kind = describe(key.kind).removeprefix("a ")
        if key.name in counted:
            kind = kind.replace("whole number", "steps")
        yield (
            code(key.name), kind, code(as_text(key.value)) or "empty", _range(key), prose(key.help),
        )  # fmt: skip


def _range(key: Key) -> str:
    """The range of a setting in signs: "≥ 0, < 1"."""
    name = key.name.rpartition(".")[2]
    bounds = next(
        (item.metadata.get(RANGE) for item in fields(key.owner) if item.name == name), None
    )
    if bounds is None:
        return ""
    signs = {"≥": bounds.at_least, ">": bounds.above, "≤": bounds.at_most, "<": bounds.below}
    given = {sign: bound for sign, bound in signs.items() if bound not in (None, math.inf)}
    return ", ".join(f"{sign}\N{NO-BREAK SPACE}{as_text(bound)}" for sign, bound in given.items())


def _tables(rows: Iterable[Row]) -> str:
    """Tables of settings, one for each group of keys ("optim.")."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row[0].strip("`").rpartition(".")[0], []).append(row)
    lines = []
    for group, members in groups.items():
        lines += [f"## {group}", ""] if group else []
        lines += [table(HEADER, members)]
    return "\n".join(lines)


def _run_page(common: list[Row]) -> str:
    choices = [
        [code("method"), "name", "", "", "The method; see the pages of methods."],
        [code("preset"), "name", code("default"), "", PRESETS_OF_ALL],
        [
            code("config"),
            "path",
            "",
            "",
            "Settings of a file, such as a run's config.yaml; repeatable.",
        ],
        *(
            [code(slot), "name", "", "", f"See [{PAGES[slot][0]}]({slot}.md)."]
            for slot in SLOT_KEYS
        ),
    ]
    return "\n".join(
        [
            "# Settings of every run",
            "",
            "Every method has these settings, with these defaults.",
            "",
            table(HEADER, choices),
            _tables(common),
        ]
    )


def _method_page(spec: Spec, rows: list[Row]) -> str:
    presets = spec.load()().presets
    lines = [
        f"# Method {spec.name}",
        "",
        f"`method={spec.name}`: {prose(_described(spec))}.",
        "",
        "These settings are its own, or have another default than in other methods;",
        "[the others](run.md) are those of every run.",
        "",
        _tables(rows),
    ]
    if presets:
        lines += ["## Presets", "", *_presets(presets)]
    return "\n".join(lines)


def _presets(presets: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    rows = [
        [
            code(f"preset={name}"),
            ", ".join(code(f"{key}={_plain(value)}") for key, value in values.items()),
        ]
        for name, values in presets.items()
    ]
    yield table(["preset", "settings"], rows)


def _plain(value: object) -> str:
    return as_text(getattr(value, "steps", value))


def _slot_page(slot: str, title: str, introduction: str, registry: Registry) -> str:
    lines = [f"# {title}", "", introduction, ""]
    for name, kind in load_all(slot, registry).items():
        lines += [f"## {name}", "", _sentence(registry.slot(slot)[name]), ""]
        rows = list(_rows(kind(), f"{slot}."))
        lines += [table(HEADER, rows) if rows else "It has no settings.\n"]
    return "\n".join(lines)


def _callbacks_page(registry: Registry) -> str:
    configs = callback_configs(registry)
    lines = [
        "# Callbacks",
        "",
        "Callbacks watch a run. `callbacks.NAME.enabled=false` leaves one out;",
        "`viewer=true` is short for `callbacks.viewer.enabled=true`.",
        "",
    ]
    for name, spec in registry.slot("callback").items():
        config = getattr(configs, name.replace("-", "_"), None)
        rows = [] if config is None else list(_rows(config, f"callbacks.{name}."))
        lines += [f"## {name}", "", _sentence(spec), ""]
        lines += [table(HEADER, rows) if rows else "It has no settings.\n"]
    return "\n".join(lines)


def _formats_page(registry: Registry) -> str:
    lines = [
        "# Formats of files",
        "",
        "`format=NAME` of `gsfw export` and `gsfw convert` chooses a format that the suffix of the",
        "file does not; `format.KEY=VALUE` is an option of it. Which one for what:",
        "[File formats](../../guides/formats.md).",
        "",
    ]
    for name, kind in load_all("exporter", registry).items():
        made = kind()
        rows = list(_rows(made, PREFIX)) if is_dataclass(kind) else []
        form = f"Ends in `{made.suffix}`" if made.suffix else "A folder"
        lines += [f"## {name}", "", _sentence(registry.slot("exporter")[name]), ""]
        lines += [f"{form}; holds {made.holds.value}.", ""]
        lines += [table(HEADER, rows) if rows else "It has no options.\n"]
    return "\n".join(lines)
