"""Study files: a study as YAML, read by a safe loader; messages name the place of a mistake."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from gsfw.core.errors import ConfigError
from gsfw.core.files.yaml_text import parsed_yaml
from gsfw.plugins.keys import suggest_key
from gsfw.plugins.values import plain
from gsfw.studies.study import COLUMNS, Rule, Study, matches, slug

KEYS = ("title", "about", "settings", "seeds", "rows", "scenes", "rules", "columns")
RULE_KEYS = ("rows", "scenes", "seeds", "settings", "skip")

RESERVED = {"out": "the study chooses the folders", "seed": "write it under seeds:"}
"""Settings that a study chooses itself, and the remedy."""


def read_study(path: Path) -> Study:
    """Read the study of a file.

    Raises:
        ConfigError: the file is missing, malformed, or has a key that studies do not have; says
            where.
    """
    where = f"study {path}"
    document = _document(path)
    if not isinstance(document, dict):
        raise ConfigError(
            f"{where}: expected 'key: value' on each line, found {_kind(document)}.",
            f"Keys: {', '.join(KEYS)}.",
        )
    _check_keys(where, document, KEYS)
    rows, scenes = (_named_settings(where, key, document.get(key)) for key in ("rows", "scenes"))
    rules = _list_of(where, "rules", document.get("rules", []), dict, "a list of rules")
    columns = _list_of(where, "columns", document.get("columns", list(COLUMNS)), str, "names")
    return Study(
        name=slug(path.stem),
        title=_text(where, "title", document.get("title", path.stem)),
        about=_text(where, "about", document.get("about", "")),
        settings=_settings(where, "settings", document.get("settings", {})),
        rows=rows,
        scenes=scenes,
        seeds=_seeds(where, "seeds", document.get("seeds", list(Study.seeds))),
        rules=tuple(
            _rule(f"{where}, rule {number}", rule, rows, scenes)
            for number, rule in enumerate(rules, start=1)
        ),
        columns=tuple(columns),
    )


class _Loader(yaml.SafeLoader):
    """Refuses repeated keys, of which PyYAML keeps the last and drops the others."""

    def compose_mapping_node(self, anchor: Any) -> yaml.MappingNode:  # noqa: ANN401 - as PyYAML
        node = super().compose_mapping_node(anchor)
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    problem = f"{key.value!r} is there twice"
                    raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
                seen.add(key.value)
        return node


def _document(path: Path) -> object:
    try:
        return parsed_yaml(path.read_text(encoding="utf-8"), _Loader)
    except FileNotFoundError:
        raise ConfigError(
            f"{path}: there is no such study file.", "Give the path of a .yaml file."
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: the study file cannot be read: {error}.") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise ConfigError(
            f"study {path}{place}: this is not valid YAML: {error.problem}.",
            "Indent with spaces, and quote texts that hold ': ' or begin with a special character.",
        ) from None
    except yaml.YAMLError as error:
        problem = " ".join(str(error).split())
        raise ConfigError(f"study {path}: this is not valid YAML: {problem}.") from None


def _check_keys(where: str, found: Mapping[Any, Any], known: Sequence[str]) -> None:
    for key in found:
        if key not in known:
            raise ConfigError(
                f"{where}: unknown key {str(key)!r}.{suggest_key(str(key), known)}",
                f"Keys: {', '.join(known)}.",
            )


def _named_settings(where: str, key: str, found: object) -> dict[str, dict[str, Any]]:
    """Rows or scenes: a mapping of names to settings."""
    if not isinstance(found, dict) or not found:
        raise ConfigError(
            f"{where}: {key}: expected a name and its settings for each, found {_kind(found)}.",
            f"Such as {key}:\n  first: {{steps: 1000}}",
        )
    named = {
        str(name): _settings(where, f"{key}: {name}", settings) for name, settings in found.items()
    }
    folders: dict[str, str] = {}
    for name in named:
        other = folders.setdefault(slug(name).lower(), name)
        if other != name:
            raise ConfigError(
                f"{where}: {key}: {other!r} and {name!r} would have the same folder.",
                "Let them differ in more than case, spaces and special characters.",
            )
    return named


def _settings(where: str, place: str, found: object) -> dict[str, Any]:
    """Settings by dotted key."""
    if found is None:
        return {}
    if not isinstance(found, dict):
        raise ConfigError(f"{where}: {place}: expected settings, found {_kind(found)}.")
    flat = _flattened(found)
    for key, value in flat.items():
        if value is None:
            raise ConfigError(f"{where}: {place}: {key} has no value.", "Write key: value.")
        if key in RESERVED:
            raise ConfigError(
                f"{where}: {place}: {key} cannot be set here.", f"{RESERVED[key]}.".capitalize()
            )
    return flat


def _flattened(found: Mapping[Any, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in found.items():
        if isinstance(value, dict):
            flat |= _flattened(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = plain(value)
    return flat


def _rule(
    where: str, found: Mapping[str, Any], rows: Mapping[str, object], scenes: Mapping[str, object]
) -> Rule:
    _check_keys(where, found, RULE_KEYS)
    if not set(found) & {"seeds", "settings", "skip"}:
        raise ConfigError(f"{where}: it changes nothing.", "Give it seeds, settings or skip.")
    return Rule(
        rows=_patterns(where, "rows", found.get("rows", "*"), rows),
        scenes=_patterns(where, "scenes", found.get("scenes", "*"), scenes),
        seeds=_seeds(where, "seeds", found["seeds"]) if "seeds" in found else None,
        settings=_settings(where, "settings", found.get("settings")),
        skip=_text(where, "skip", found.get("skip", "")),
    )


def _patterns(where: str, key: str, found: object, known: Mapping[str, object]) -> tuple[str, ...]:
    """One name or several, each of which has to fit a known name."""
    listed = found if isinstance(found, list) else [found]
    patterns = [str(item) for item in listed]
    for pattern in patterns:
        if not any(matches(name, [pattern]) for name in known):
            raise ConfigError(
                f"{where}: {key}: {pattern!r} names none.{suggest_key(pattern, known)}",
                f"There are {', '.join(known)}.",
            )
    return tuple(patterns)


def _seeds(where: str, key: str, found: object) -> tuple[int, ...]:
    seeds = found if isinstance(found, list) else [found]
    whole = [seed for seed in seeds if isinstance(seed, int) and not isinstance(seed, bool)]
    if not seeds or len(whole) != len(seeds) or len(set(whole)) != len(whole):
        raise ConfigError(
            f"{where}: {key}: expected different whole numbers, found {found}.",
            f"Such as {key}: [1, 2, 3].",
        )
    return tuple(whole)


def _list_of(where: str, key: str, found: object, kind: type, expected: str) -> list[Any]:
    if not isinstance(found, list) or not all(isinstance(item, kind) for item in found):
        raise ConfigError(f"{where}: {key}: expected {expected}, found {found!r}.")
    return found


def _text(where: str, key: str, found: object) -> str:
    if not isinstance(found, str):
        raise ConfigError(f"{where}: {key}: expected text, found {_kind(found)}.")
    return " ".join(found.split())


def _kind(found: object) -> str:
    """Kind of a YAML value, in words."""
    names = {dict: "settings", list: "a list", str: "text", type(None): "nothing"}
    return names.get(type(found), f"{found!r}")
