"""`gsfw info`: describes a splat file, a model file, a run or a data set."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import Options, positional, read_options
from gsfw.core.config import AUTO
from gsfw.core.ranges import number

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.plugins.registry import Registry


@dataclass(kw_only=True)
class InfoOptions(Options):
    """Describe a splat file, a model file, a run or a data set."""

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw info latest",
        "gsfw info splats.ply json=true",
        "gsfw info data=path/to/capture downscale=2",
    )

    what: str = positional("FILE|RUN|DATA", default="")
    """A splat file, a model file, a run (a folder, a checkpoint, or latest), or a data set."""
    data: str = ""
    """A data set, if it must not be taken for anything else."""
    format: str = AUTO
    """Format of the data set: auto, or the name of a datamanager that gsfw plugins lists."""
    downscale: float = number(1.0, at_least=1, below=math.inf)
    """Factor by which a data set's images would be shrunk."""


def run(arguments: list[str]) -> int:
    """Recognise the argument, and describe it."""
    options = read_options("info", InfoOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.run_description import run_text
    from gsfw.core.progress import stage
    from gsfw.plugins.registry import installed

    console = Console(options.json)
    with stage("reading"):
        document = _describe(options, installed(), console)
    if console.json_only:
        console.result(document)
    elif document["kind"] == "run":
        console.say(run_text(document))
    else:
        console.table(["", ""], _rows(document), _title(document))
    return 0


def _describe(options: InfoOptions, registry: Registry, console: Console) -> dict[str, Any]:
    """The document of the argument.

    Raises:
        ConfigError: no argument or two were given.
        DataError: it is of an unknown kind, or damaged.
    """
    from gsfw.commands.interface.run_description import describe_run
    from gsfw.commands.interface.runs import LATEST, MODEL_SUFFIX, find_run
    from gsfw.core.errors import ConfigError
    from gsfw.core.loop.run_folder import RunFolder
    from gsfw.formats.description import describe_model, describe_splats
    from gsfw.plugins.automatic import BUILT_IN_SCENE
    from gsfw.plugins.initial_splats import importer_of
    from gsfw.plugins.loading import load

    what, data = options.what, options.data
    if what and data:
        raise ConfigError(f"gsfw info: both {what} and data={data} are given.", "Give one of them.")
    if not what and not data and options.format != BUILT_IN_SCENE:
        raise ConfigError(
            "gsfw info: the file, run or data set is missing.",
            "Give a splat file, a run, latest, or a data set; see gsfw info --help.",
        )
    if what == LATEST or what.endswith(".pt") or (what and RunFolder(Path(what)).config.is_file()):
        return describe_run(find_run(what, console.say).folder)
    if what.endswith(MODEL_SUFFIX) and Path(what).is_file():
        return describe_model(Path(what))
    if what and Path(what).exists() and options.format == AUTO:
        importer = importer_of(Path(what), registry)
        if importer:
            reader = load("importer", registry.slot("importer")[importer])()
            content, size = reader.read(Path(what)), reader.size(Path(what))
            return describe_splats(Path(what), importer, content, size)
        if Path(what).is_file():
            _check_known(what, registry)
    return _describe_data(what or data, options, registry)


def _describe_data(data: str, options: InfoOptions, registry: Registry) -> dict[str, Any]:
    """The document of a data set; reads cameras and points, and the headers of its images.

    Raises:
        ConfigError: there is no such format.
        DataError: the data cannot be used; names the cause and the place.
    """
    from gsfw.core.config import DataManagerConfig
    from gsfw.core.datamanager import DataRequest
    from gsfw.core.files.mirror import local_place
    from gsfw.datamanagers.description import describe_data, fitting_downscale
    from gsfw.plugins.automatic import Choice, choose_datamanager
    from gsfw.plugins.loading import load
    from gsfw.preparation.check.plan import suited_methods
    from gsfw.preparation.check.viewpoints import Viewpoints

    form, downscale = options.format, options.downscale
    is_given = form != AUTO
    choice = Choice(form, "it was asked for") if is_given else choose_datamanager(data, registry)
    kind: type[DataManagerConfig] = load("datamanager", registry.find("datamanager", choice.name))
    request = DataRequest(local_place(data) if data else None, downscale=downscale)
    with closing(kind().build(request)) as manager:
        fitting = fitting_downscale(manager, downscale)
        words = ["gsfw", "train", f"method={suited_methods(Viewpoints.of(manager))[0]}"]
        words += [f"data={data}"] if data else []
        words += [f"datamanager={form}"] if is_given else []
        words += [f"downscale={fitting:g}"] if fitting > 1 else []
        return {
            "kind": "data set",
            "path": data,
            "format": choice.name,
            "why": choice.reason,
            **describe_data(manager),
            "notes": list(manager.notes()),
            "next": shlex.join(words),
        }


def _check_known(what: str, registry: Registry) -> None:
    """Refuse a file that is no data set either; the message names the readable formats.

    Raises:
        DataError: no data manager recognises it.
    """
    from gsfw.core.errors import DataError
    from gsfw.core.files.reading import check_downloaded
    from gsfw.plugins.automatic import choose_datamanager

    check_downloaded(Path(what))
    try:
        choose_datamanager(what, registry)
    except DataError:
        raise DataError(
            f"{what} is neither a splat file nor a data set that can be read here.",
            f"Splat files: {', '.join(registry.slot('importer'))}. "
            f"Data sets: {', '.join(registry.slot('datamanager'))}.",
        ) from None


def _title(document: Mapping[str, Any]) -> str:
    return f"{document['path'] or 'the built-in scene'}: {document['kind']}"


def _rows(document: Mapping[str, Any], prefix: str = "") -> list[Sequence[str]]:
    """Rows of a table for a document; nested rows have their names as a prefix."""
    rows: list[Sequence[str]] = []
    for key, value in document.items():
        name = f"{prefix}{key}".replace("_", " ")
        if isinstance(value, Mapping):
            rows += _rows(value, f"{name} ")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            rows += [
                (name if index == 0 else "", ", ".join(f"{k} {_text(v)}" for k, v in item.items()))
                for index, item in enumerate(value)
            ]
        elif prefix or key not in ("kind", "path"):
            rows.append((name, _text(value)))
    return rows


def _text(value: object) -> str:
    """Format a value for people."""
    if value is None or value in ("", []):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, list):
        return ("; " if isinstance(value[0], str) else ", ").join(map(_text, value))
    return str(value)
