"""The page of verbs: usage, options and examples of each, from its help and its options."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import fields
from itertools import starmap
from typing import Any

from gsfw.commands.interface.arguments import HelpRequested, Options
from gsfw.commands.interface.help import COMMON
from gsfw.plugins.keys import field_help, keys
from gsfw.plugins.loading import load_all
from gsfw.plugins.registry import Registry
from gsfw.plugins.values import as_text, describe
from reference.markdown import code, docstring, prose, table

INTRODUCTION = """# Verbs

Every option is `key=value`, in any order; `--key value` works as well. `gsfw VERB --help` prints
what is here. Every verb also takes `json=true` (one JSON document on standard output, and nothing
else there) and `debug=true` (the traceback of an error). Exit codes: 0 done, 1 failed, 2 an error
that you can correct, 130 interrupted.
"""


def verbs_page(registry: Registry) -> str:
    """All verbs, by name."""
    verbs = registry.slot("command")
    rows = [[f"[{name}](#{name})", prose(spec.description)] for name, spec in verbs.items()]
    sections = [_section(name, run) for name, run in load_all("command", registry).items()]
    return "\n".join([INTRODUCTION, table(["verb", "action"], rows), *sections])


def _section(verb: str, run: Any) -> str:  # noqa: ANN401 - a function of a plugin
    help_of_verb = _help(run)
    if not help_of_verb.options:
        return f"## {verb}\n\n```text\n{help_of_verb}\n```\n"
    return f"## {verb}\n\n" + "\n".join(starmap(_options, _forms(verb, run)))


def _forms(verb: str, run: Any) -> Iterator[tuple[str, type[Options]]]:  # noqa: ANN401 - a function
    """The verb with its options, then its forms with a word and other options ("plugins check")."""
    kinds = _help(run).options
    for kind in kinds:
        yield verb, kind
    examples = (line.split() for kind in kinds for line in kind.examples)
    seconds = dict.fromkeys(words[2] for words in examples if len(words) > 2)
    for word in filter(str.isalpha, seconds):
        for kind in _help(run, word).options:
            if kind not in kinds:
                yield f"{verb} {word}", kind


def _help(run: Any, *words: str) -> HelpRequested:  # noqa: ANN401 - a function of a plugin
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            run([*words, "--help"])
    except HelpRequested as wanted:
        return wanted
    raise ValueError(f"{run} has no help")


def _options(verb: str, kind: type[Options]) -> str:
    """Usage, meaning, options and examples of one class of options."""
    explained = field_help(kind)
    words = {item.name: item.metadata["word"] for item in fields(kind) if "word" in item.metadata}
    make: Any = kind
    blank = make(**dict.fromkeys(words, ""))
    rows = [[code(word), "", "", prose(explained[name])] for name, word in words.items()]
    rows += [
        [
            code(key.name),
            describe(key.kind).removeprefix("a "),
            code(as_text(key.value)),
            prose(key.help),
        ]
        for key in keys(blank)
        if key.name not in words and key.name not in COMMON
    ]
    usage = " ".join(["gsfw", verb, *words.values(), "[key=value ...]"])
    parts = [f"```text\n{usage}\n```", docstring(kind.__doc__ or "")]
    if rows:
        parts.append(table(["option", "type", "default", "meaning"], rows))
    if kind.examples:
        parts.append("```sh\n" + "\n".join(kind.examples) + "\n```")
    return "\n\n".join(parts) + "\n"
