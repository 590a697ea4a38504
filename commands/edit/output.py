"""Output: the file that an edit writes, and its format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from gsfw.commands.edit.verb import EditOptions
from gsfw.commands.interface.runs import RunArgument
from gsfw.core.errors import ConfigError
from gsfw.core.exchange import Exporter, Holds
from gsfw.core.files.reading import names_folder
from gsfw.plugins.exporters import check_suffix, format_of, make_exporter, writable_suffixes
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry

PLY, MODEL = "ply", "gsfw"
STEPS_SUFFIX = ".edits.json"
"""Suffix of the file of steps beside the written one."""


@dataclass(frozen=True)
class Output:
    """The file to write."""

    path: Path
    format: str
    """Name of the exporter."""
    exporter: Exporter

    @property
    def steps(self) -> Path:
        """The file of steps beside it."""
        return self.path.with_name(self.path.name + STEPS_SUFFIX)

    @property
    def is_model(self) -> bool:
        """True if it holds a model at all times."""
        return self.exporter.holds is Holds.MODEL

    @staticmethod
    def of(
        options: EditOptions,
        given: Mapping[str, str],
        found: RunArgument,
        moves: bool,
        registry: Registry,
    ) -> Output:
        """The file that ``out`` names, or one beside the input.

        Args:
            options: out and format; without out the file lies beside the input, and without format
                the suffix chooses it.
            given: options of the format by name, as text.
            found: the input, which is never written to.
            moves: true if the input is a run that moves.
            registry: the installed parts.

        Raises:
            ConfigError: the format cannot be written by an edit, or the file is the input.
        """
        form = _form(options, found, moves, registry)
        exporter = make_exporter(form, registry, given)
        _check_content(form, exporter)
        path = Path(options.out) if options.out else _beside(found, exporter.suffix, registry)
        check_suffix(path, form, exporter, registry)
        _check_place(options.out, path, found)
        return Output(path, form, exporter)


def _form(options: EditOptions, found: RunArgument, moves: bool, registry: Registry) -> str:
    """The name of the format: given, of the suffix of out, or that of the input.

    Raises:
        ConfigError: nothing writes files with the suffix of out.
    """
    if options.format:
        return options.format
    if not options.out:
        return _same_form(found, moves, registry)
    out = Path(options.out)
    _check_file(options.out)
    form = format_of(out, registry)
    if form is None:
        raise ConfigError(
            f"{out.name}: nothing writes splats or models to files with this suffix.",
            f"Suffixes that can be written: {writable_suffixes(registry)}. Or give the format: "
            f"format={PLY}",
        )
    return form


def _same_form(found: RunArgument, moves: bool, registry: Registry) -> str:
    """The format of the input; PLY where that cannot be written or holds more than one time."""
    if found.model_file is not None or (found.splat_file is None and moves):
        return MODEL
    form = None if found.splat_file is None else format_of(found.splat_file, registry)
    if form is None:
        return PLY
    kind: type[Exporter] = load("exporter", registry.find("exporter", form))
    return form if kind.holds is Holds.SPLATS else PLY


def _check_content(form: str, exporter: Exporter) -> None:
    """Check that what is edited can be written in a format.

    Raises:
        ConfigError: the format holds what only a run has, or is a folder.
    """
    if exporter.holds in (Holds.TRACKS, Holds.DEPTHS):
        raise ConfigError(
            f"format {form} holds {exporter.holds.value}; an edit writes splats or models.",
            f"Write out=FILE.gsfw first, then: gsfw export FILE.gsfw format={form}",
        )
    if exporter.is_folder:
        raise ConfigError(
            f"format {form} is a folder of files; an edit writes one file.",
            f"Write out=FILE.ply first, then: gsfw convert FILE.ply FOLDER format={form}",
        )


def _check_file(given: str) -> None:
    """Check that a path does not name a folder.

    Raises:
        ConfigError: it does.
    """
    if names_folder(given):
        path = Path(given)
        raise ConfigError(f"out={path} is a folder.", f"Name the file: out={path / 'edited.ply'}")


def _check_place(out: str, path: Path, found: RunArgument) -> None:
    """Check that a path is a file other than the input.

    Args:
        out: the path as it is given; empty if none is.
        path: the path of the file.
        found: the input.

    Raises:
        ConfigError: it is a folder, or the input.
    """
    _check_file(out or str(path))
    given = found.splat_file or found.model_file or found.checkpoint
    if given is not None and path.exists() and path.samefile(given):
        raise ConfigError(
            f"out={path} is the input, which is never changed.", "Choose another name."
        )
    own = (found.folder.splats, found.folder.path / "model.gsfw")
    if given is None and path.absolute() in [file.absolute() for file in own]:
        raise ConfigError(
            f"out={path} is the run's own file, which is never changed.", "Choose another name."
        )


def _beside(found: RunArgument, suffix: str, registry: Registry) -> Path:
    """FILE.edited with a suffix beside a file; edited in the folder of a run."""
    given = found.splat_file or found.model_file
    if given is None:
        return found.folder.path / f"edited{suffix}"
    form = format_of(given, registry)
    if form is None:
        return given.with_name(f"{given.stem}.edited{suffix}")
    kind: type[Exporter] = load("exporter", registry.find("exporter", form))
    return given.with_name(f"{given.name[: -len(kind.suffix)]}.edited{suffix}")
