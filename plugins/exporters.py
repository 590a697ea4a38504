"""Exporters: chosen by name, or by the suffix of a file, and made with their options."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import is_dataclass
from pathlib import Path

from gsfw.core.errors import ConfigError, DataError, UserError
from gsfw.core.exchange import Exporter
from gsfw.core.maths.spherical_harmonics import MAX_DEGREE
from gsfw.core.ranges import check_ranges
from gsfw.plugins.keys import Key, keys, suggest_key
from gsfw.plugins.loading import load, load_all
from gsfw.plugins.registry import Registry
from gsfw.plugins.specs import PROJECT
from gsfw.plugins.values import as_text, describe, parse

PREFIX = "format."
"""Beginning of the keys of a format's options on the command line."""


def format_of(path: Path, registry: Registry) -> str | None:
    """The format that writes files with the suffix of ``path``; ``None`` if none does.

    The longest suffix wins (``.compressed.ply`` before ``.ply``); then a format of gsfw, so that an
    installed plugin changes no command; then the first suffix of a format before its other ones,
    then the format whose name is the suffix, and then the first by name.
    """
    found = _fitting(path, registry)
    return found[1] if found else None


def _fitting(path: Path, registry: Registry) -> tuple[str, str] | None:
    """The suffix of a file that ``format_of`` goes by, and its format."""
    kinds: dict[str, type[Exporter]] = load_all("exporter", registry)
    specs, name = registry.slot("exporter"), path.name.lower()
    fitting = [
        (
            -len(suffix),
            specs[form].distribution != PROJECT,
            suffix != kind.suffix,
            f".{form}" != suffix,
            form,
            suffix,
        )
        for form, kind in kinds.items()
        for suffix in (kind.suffix, *kind.other_suffixes)
        if suffix and name.endswith(suffix)
    ]
    if not fitting:
        return None
    *_, form, suffix = min(fitting)
    return suffix, form


def format_for(path: Path, registry: Registry, place: str) -> str:
    """The format of ``format_of``.

    Args:
        path: the file to write.
        registry: the installed parts.
        place: text of the argument, for the message, such as "out=scene.ply".

    Raises:
        ConfigError: no exporter writes such files; lists the suffixes.
    """
    form = format_of(path, registry)
    if form is None:
        raise ConfigError(
            f"{place}: no exporter writes files that end in {path.suffix.lower()!r}.",
            f"Suffixes that can be written: {writable_suffixes(registry)}. Or give the format: "
            "format=ply",
        )
    return form


def writable_suffixes(registry: Registry) -> str:
    """The suffixes of all formats, for messages."""
    kinds: dict[str, type[Exporter]] = load_all("exporter", registry)
    suffixes = (name for kind in kinds.values() for name in (kind.suffix, *kind.other_suffixes))
    return ", ".join(dict.fromkeys(filter(None, suffixes)))


def make_exporter(
    form: str, registry: Registry, given: Mapping[str, object] | None = None
) -> Exporter:
    """The exporter of a format.

    Args:
        form: its registered name.
        registry: the installed parts.
        given: values of its options by name (without ``format.``), as text or as plain data.

    Raises:
        ConfigError: there is no such format or option, or a value is wrong; lists the options.
    """
    kind: type[Exporter] = load("exporter", registry.find("exporter", form))
    if not given:
        return kind()
    known = {key.name: key for key in exporter_options(kind)}
    values: dict[str, object] = {}
    for name, value in given.items():
        full = PREFIX + name
        text = f"{full}={as_text(value)}"
        if full not in known:
            raise ConfigError(
                f"{text}: format {form} has no option {name!r}.{suggest_key(full, known)}",
                _listed(form, known),
            )
        try:
            values[name] = parse(known[full].kind, value)
        except ValueError:
            raise ConfigError(
                f"{text}: expected {describe(known[full].kind)}, found {as_text(value)!r}.",
                f"{full}: {known[full].help}",
            ) from None
    exporter = kind(**values)
    check_ranges(exporter, PREFIX)
    return exporter


def check_suffix(path: Path, form: str, exporter: Exporter, registry: Registry) -> None:
    """Check that the name of a file is not that of another format.

    A suffix that no format has is any format's; ``.ply`` is also that of its other kinds.

    Raises:
        ConfigError: it is.
    """
    found = None if path.is_dir() else _fitting(path, registry)
    if found is None or found[1] == form:
        return
    suffix, named = found
    own = (exporter.suffix, Path(exporter.suffix).suffix, *exporter.other_suffixes)
    if suffix in own:
        return
    stem = path.name[: -len(suffix)]
    other = f"a folder: {stem}" if exporter.is_folder else f"another name: {stem}{exporter.suffix}"
    raise ConfigError(
        f"{path}: files that end in {suffix} have format {named}, and format={form} is given.",
        f"Leave format out, or give {other}",
    )


def check_sh_degree(degree: int | None, form: str, exporter: Exporter) -> None:
    """Check the degree above which nothing is to be written.

    Raises:
        ConfigError: there is no such degree, or the format holds less.
    """
    if degree is None:
        return
    if not 0 <= degree <= MAX_DEGREE:
        raise ConfigError(f"sh_degree={degree}: expected a degree from 0 to {MAX_DEGREE}.")
    if degree > exporter.most_sh_degree:
        raise ConfigError(
            f"sh_degree={degree}: format {form} holds degree {exporter.most_sh_degree} at most.",
            "Leave sh_degree out for all that the format holds, or choose another format.",
        )


@contextmanager
def readable_value_errors(path: Path, form: str) -> Iterator[None]:
    """Turn an exporter's ValueError into a message for the user.

    Raises:
        DataError: in place of the exporter's ValueError.
    """
    try:
        yield
    except UserError:
        raise
    except ValueError as error:
        raise DataError(f"{path}: format {form} cannot hold this model: {error}.") from error


def exporter_options(kind: type[Exporter]) -> list[Key]:
    """The options of a format by full key ("format.version"), with their defaults."""
    return list(keys(kind(), PREFIX)) if is_dataclass(kind) else []


def _listed(form: str, known: Mapping[str, Key]) -> str:
    """The options of a format as an advice."""
    if not known:
        return "It has no options."
    options = ", ".join(f"{key.name}={as_text(key.value)}" for key in known.values())
    return f"Options of {form}: {options}. What they do: gsfw export format={form} --help"
