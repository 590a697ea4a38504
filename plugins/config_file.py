"""Config files: settings as flat or nested YAML, read by a safe loader that builds plain data."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from gsfw.core.config import INIT_WORDS
from gsfw.core.errors import ConfigError
from gsfw.core.files.yaml_text import parsed_yaml
from gsfw.plugins.registry import package
from gsfw.plugins.settings import Layer, Settings
from gsfw.plugins.specs import PROJECT

SCHEMA = 1
"""Version of the layout; raised when an older gsfw could not read a newer file."""

HEADER = ("schema", "gsfw", "torch", "python", "plugins", "command line")
"""Keys of the origin of a file; they are no settings."""

GIVEN = "given"
"""Key of the list of settings that the user, or a plan, chose."""

PLANNED = "planned"
"""Key of the list of those that a plan decided: a file from which a run is planned anew does not
keep them."""

NOTE = """\
# Made by gsfw. Use it again with config=FILE: that takes the keys under "given", and the rest
# follows from them. To edit other values, add their keys there, or delete "given" to take all.
"""

FORMER_RATES: Mapping[str, tuple[float, frozenset[str]]] = {
    "optim.factor": (1.0, frozenset({"optim.means_lr", "optim.sh_dc_lr"})),
    "optim.cooldown": (0.0, frozenset({"optim.sparse"})),
    "optim.motion_factor": (1.0, frozenset({"optim.motion_lr"})),
}
"""Settings that runs of older versions did not have, the values that these runs had in effect, and
settings of all runs that have such rates. Such a run keeps all of its rates, since the defaults of
the others are made for the new values."""
PLACES = ("data", "init")
"""Settings that may name a file: saved as absolute paths, so that they hold in any folder."""


def write_config(settings: Settings, arguments: Sequence[str]) -> str:
    """Write a run's config.yaml, from which ``config=FILE`` makes the same run again.

    All values are written, so that the run can be restored; ``given`` names those that the user
    chose, so that one more change has the same effect as on the command line of the first run.
    The folder of the run is omitted: the next run has its own.

    Args:
        settings: settings of the run.
        arguments: the command line, for people.
    """
    values = settings.flat()
    del values["out"]
    given = [key for key in settings.given if key in values]
    if settings.preset:
        values = {"method": settings.method.name, "preset": settings.preset, **values}
        given.append("preset")
    for key in PLACES:
        text = values.get(key)
        if text and text not in INIT_WORDS and Path(text).exists():
            values[key] = str(Path(text).resolve())
    parts = [settings.method, *settings.choices.values()]
    header = {
        "schema": SCHEMA,
        "gsfw": metadata.version(PROJECT),
        "torch": metadata.version("torch"),
        "python": platform.python_version(),
        "plugins": sorted({package(part) for part in parts if part.distribution != PROJECT}),
        "command line": shlex.join(["gsfw", *arguments]),
        GIVEN: given,
        **({PLANNED: [*settings.planned]} if settings.planned else {}),
    }
    head = yaml.safe_dump(header, sort_keys=False, allow_unicode=True, width=100)
    body = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=100)
    return f"{NOTE}{head}\n{body}"


def read_config(path: Path, everything: bool = False) -> Layer:
    """Read the settings of a config file.

    Args:
        path: path of the file.
        everything: true to read a run's own file as the exact values of that run; false to read its
            given values, from which the rest is resolved again. Any other file is read in full.

    Raises:
        ConfigError: it is missing, too large, no YAML mapping, or written by a newer gsfw; or
            ``given`` or ``planned`` is not a list of its keys.
    """
    where = f"config file {path}"
    try:
        document = _parsed(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"config={path}: there is no such file.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"config={path}: the file cannot be read: {error}.") from None
    except yaml.YAMLError as error:
        problem = " ".join(str(error).split())
        raise ConfigError(
            f"{where}: this is not valid YAML: {problem}.", "Write one 'key: value' on each line."
        ) from None
    if document is None:
        document = {}
    if not isinstance(document, dict):
        raise ConfigError(
            f"{where}: expected 'key: value' on each line, found {type(document).__name__}."
        )
    _check_schema(where, document)
    values = dict(
        _flattened({key: document[key] for key in document if key not in (*HEADER, GIVEN, PLANNED)})
    )
    found = document.get("plugins")
    packages = tuple(map(str, found)) if isinstance(found, list) else ()
    if GIVEN not in document:
        return Layer(where, values, packages=packages)
    given = _named(where, GIVEN, document[GIVEN], values)
    planned = _named(where, PLANNED, document.get(PLANNED, []), values)
    rates = {key for key in values if key in FORMER_RATES or key.endswith("_lr")}
    for key, (value, with_keys) in FORMER_RATES.items():
        if values.keys() >= with_keys and key not in values:
            values[key], given = value, given | {key} | rates
    if everything:
        return Layer(where, values, given, planned, packages=packages)
    if "minutes" not in values:  # Before gsfw planned runs by time, all had a number of steps.
        given |= {"steps"}
    values = {key: value for key, value in values.items() if key in given}
    return Layer(where, values, planned=planned & given, packages=packages)


def read_header(path: Path) -> dict[str, Any]:
    """The origin of a run: versions, plugins and command line; of a file that can be read."""
    document = _parsed(path.read_text(encoding="utf-8"))
    return {key: document[key] for key in HEADER if key in document and key != "schema"}


def _parsed(text: str) -> Any:  # noqa: ANN401 - plain data of any kind
    """Plain data of YAML; errors in the words of PyYAML's own parser."""
    try:
        return parsed_yaml(text)
    except yaml.MarkedYAMLError:
        return parsed_yaml(text, yaml.SafeLoader)


def _named(where: str, name: str, found: object, values: Mapping[str, Any]) -> frozenset[str]:
    """The keys of a list in a file, which all have values there."""
    if not isinstance(found, list):
        raise ConfigError(f"{where}: {name}: expected a list of keys, found {found!r}.")
    for key in found:
        if not isinstance(key, str) or key not in values:
            raise ConfigError(
                f"{where}: {name} has {key!r}, which has no value in this file.",
                "Add the value, or take the name away.",
            )
    return frozenset(found)


def _check_schema(where: str, document: Mapping[Any, Any]) -> None:
    schema = document.get("schema", SCHEMA)
    if not isinstance(schema, int) or schema > SCHEMA or schema < 1:
        raise ConfigError(
            f"{where}: expected schema {SCHEMA}, found {schema}.",
            f"It was written by gsfw {document.get('gsfw', 'of another version')}; "
            f"this is {metadata.version(PROJECT)}. Use that version to read it.",
        )


def _flattened(values: Mapping[Any, Any], prefix: str = "") -> list[tuple[str, Any]]:
    """Flatten nested mappings to dotted keys."""
    found: list[tuple[str, Any]] = []
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            found += _flattened(value, f"{name}.")
        else:
            found.append((name, value))
    return found
