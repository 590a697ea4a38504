"""`gsfw prepare`: a data set for training, from photos, video, or another tool's data set."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsfw.commands.interface.arguments import parse
from gsfw.commands.interface.execution import cpu_resources_of, executor_of
from gsfw.commands.interface.following_times import layout_with_times
from gsfw.commands.interface.following_training import (
    FollowingTraining,
    method_for_motion,
    read_both,
)
from gsfw.commands.interface.interrupt import interrupted_once
from gsfw.commands.interface.prepare_options import PrepareOptions, preparation_rule
from gsfw.commands.interface.prepared_data import data_settings, examine, write_dense
from gsfw.core.errors import ConfigError, DataError, UnavailableError

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.plugins.settings import Settings
    from gsfw.preparation.machines import Machines
    from gsfw.preparation.preparation_rule import PreparationRule
    from gsfw.preparation.workspace import Workspace

PREPARED = Path("prepared")
"""Default folder of results."""
ROWS_SHOWN = 20
"""Largest number of unused files that are listed."""
STOPPING = "stopping, which may take some seconds; the same command will continue from here"
REFUSED = 1
"""Exit code of a capture that cannot be trained on."""


def run(tokens: list[str]) -> int:
    """Prepare a data set, examine it, and print the findings; train it where that is asked for."""
    options, following = read_both(tokens)
    inputs = _inputs(options)

    from gsfw.commands.interface.console import Console
    from gsfw.commands.interface.progress import load_torch

    cpu_resources_of(options)
    load_torch()
    _check_colmap()
    console = Console(options.json or (following is not None and parse(following).flag("json")))
    for path in inputs:
        _check_exists(path)
    if following is not None and (method := method_for_motion(following)):
        unposed = inputs if _data_set(options, inputs) is None else None
        layout = layout_with_times(method, options.layout, unposed, console)
        options = replace(options, layout=layout)
    place, rule = _place(options, inputs), preparation_rule(options)
    with interrupted_once(STOPPING), place.claimed(inputs):
        document = _document(console, options, inputs, place, rule)
        if options.dense and document["verdict"] != "will not train":
            write_dense(console, place.path)
    _show(console, document, following is not None)
    if following is not None and document["next"]:
        return _train(console, place.path, document, following)
    console.result(document)
    return REFUSED if document["verdict"] == "will not train" else 0


def _train(console: Console, data: Path, document: Mapping[str, Any], words: Sequence[str]) -> int:
    """Train the data set; return the exit code, and print the document of the training."""
    from gsfw.commands import resume, train

    said = ["json=true"] if console.json_only and not parse(words).flag("json") else []
    training = FollowingTraining(data, (*words, *said), document["suggested"])
    return training.train(train.run, resume.run, console)


def _document(
    console: Console,
    options: PrepareOptions,
    inputs: tuple[Path, ...],
    place: Workspace,
    rule: PreparationRule,
) -> dict[str, Any]:
    """Prepare or convert the inputs; return the document."""
    if options.again:
        place.remove(place.journal, place.views)
    source = _data_set(options, inputs)
    if source is None:
        return _prepare(console, options, inputs, place, rule)
    if options.executor == "ray":
        raise ConfigError(
            f"executor=ray: {source.config.data} has cameras already, which are kept.",
            "Leave it out, or compute new cameras with poses=compute.",
        )
    return _convert(console, source, place, options, rule)


def _inputs(options: PrepareOptions) -> tuple[Path, ...]:
    """The inputs as paths.

    Raises:
        ConfigError: one is an empty word, which would mean the current folder.
    """
    if not all(options.inputs):
        raise ConfigError(
            "gsfw prepare: an INPUT is empty.",
            "Is a variable of the shell not set? For the folder that you are in, write a dot.",
        )
    return tuple(Path(text) for text in options.inputs)


def _check_colmap() -> None:
    """Check that COLMAP can be used, before the inputs are read.

    Raises:
        UnavailableError: COLMAP cannot be used.
    """
    from gsfw.preparation.native import load_colmap

    try:
        load_colmap()
    except (ImportError, RuntimeError) as error:
        said = " ".join(str(error.__cause__ or error.__context__ or error).split()).rstrip(".")
        raise UnavailableError(
            f"pycolmap, which computes cameras, cannot be loaded: {said}.",
            "Install it anew with: pip install --force-reinstall 'pycolmap>=4.2'",
        ) from error


def _check_exists(path: Path) -> None:
    """Check that an input exists, and is no run or splats, whose images would be taken for photos.

    Raises:
        DataError: it does not; names the nearest path. Or it is a run or splats.
    """
    from gsfw.plugins.automatic import refuse_run
    from gsfw.plugins.initial_splats import refuse_splats
    from gsfw.plugins.registry import installed, what_is_missing

    if not path.exists():
        raise DataError(f"{path}: there is no such file or folder.", what_is_missing(path))
    refuse_run(path, str(path), "folder of photos")
    refuse_splats(path, installed())


def _place(options: PrepareOptions, inputs: tuple[Path, ...]) -> Workspace:
    from gsfw.preparation.workspace import Workspace

    return Workspace(Path(options.out) if options.out else PREPARED / inputs[0].resolve().stem)


def _data_set(options: PrepareOptions, inputs: tuple[Path, ...]) -> Settings | None:
    """Settings to open an input whose cameras are kept; ``None`` if cameras are computed.

    Raises:
        ConfigError: cameras of several inputs are to be kept.
        DataError: cameras are to be kept, and there are none.
    """
    from gsfw.plugins.automatic import choose_datamanager
    from gsfw.plugins.registry import installed

    if options.poses == "keep" and len(inputs) > 1:
        raise ConfigError(
            f"poses=keep: {len(inputs)} inputs are given.", "Give one data set at a time."
        )
    if options.poses == "compute" or len(inputs) > 1:
        return None
    try:
        choose_datamanager(str(inputs[0]), installed())
    except DataError:
        if options.poses == "keep":
            raise
        return None
    settings = data_settings(inputs[0])
    if settings.choices["datamanager"].name == "transforms":
        # Training needs depths only for a plugin; a converted data set keeps them.
        return data_settings(inputs[0], ("datamanager.depth", "true"))
    return settings


def _prepare(
    console: Console,
    options: PrepareOptions,
    inputs: tuple[Path, ...],
    place: Workspace,
    rule: PreparationRule,
) -> dict[str, Any]:
    """Compute cameras; return the document."""
    from gsfw.commands.interface.progress import StageBars
    from gsfw.core.progress import shown_by
    from gsfw.preparation.native import aborts_told, log_into
    from gsfw.preparation.preparation import Preparation
    from gsfw.preparation.report import document_of_preparation

    log_into(place.log)
    progress = shown_by(StageBars(console).stage)
    with aborts_told(place.path), _machines(options) as machines, progress:
        rule = replace(rule, machines=machines)
        prepared = Preparation(inputs, place, rule, console.say).run()
    examined = examine(place.path) if prepared.written else None
    return document_of_preparation(inputs, place, prepared, examined)


@contextmanager
def _machines(options: PrepareOptions) -> Iterator[Machines | None]:
    """The machines of executor=ray, whose jobs end with the context.

    Raises:
        UnavailableError: Ray is not installed, or there is no cluster.
    """
    from gsfw.preparation.machines import Machines

    if options.executor == "local":
        yield None
        return
    with executor_of(options, options.jobs) as executor:
        yield Machines(executor, cpu_resources_of(options))


def _convert(
    console: Console,
    source: Settings,
    place: Workspace,
    options: PrepareOptions,
    rule: PreparationRule,
) -> dict[str, Any]:
    """Keep the cameras of a data set; return the document."""
    from gsfw.commands.interface.progress import StageBars
    from gsfw.core.progress import shown_by
    from gsfw.datamanagers.capture import Capture
    from gsfw.plugins.opening import open_data
    from gsfw.preparation.report import document_of_conversion
    from gsfw.preparation.writing.conversion import ConversionRule, convert

    name = source.choices["datamanager"].name
    console.say(
        f"{source.config.data} has cameras already ({name}): they are kept; poses=compute makes "
        "new ones from its images"
    )
    with closing(open_data(source)) as data:
        if not isinstance(data, Capture):
            raise DataError(
                f"{source.config.data}: data manager {name} gives no images as files.",
                "Only formats whose images are files or videos can be converted.",
            )
        # Without its data set, no stage of an earlier preparation is finished any more.
        place.remove(place.journal, place.images, place.sparse)
        rules = ConversionRule(options.layout, rule.output)
        with shown_by(StageBars(console).stage):
            converted = convert(data.recording, place.path, rules, rule.jobs)
    return document_of_conversion(source.config.data, name, place, converted, examine(place.path))


def _show(console: Console, document: Mapping[str, Any], trained: bool) -> None:
    """Print the document for people, and the next command unless it is trained anyway."""
    from gsfw.planning.asked import USUAL
    from gsfw.preparation.report import result_lines, unused_rows

    console.say()
    for sentence in document.get("figures", ()):
        console.say(sentence)
    rows = unused_rows(document)
    if rows:
        console.table(["not used", "reason", ""], rows[:ROWS_SHOWN])
    if len(rows) > ROWS_SHOWN:
        console.say(f"and {len(rows) - ROWS_SHOWN} more: {Path(document['out']) / 'prepare.json'}")
    for line in result_lines(document):
        console.say(line)
    if document["next"] and not trained:
        console.say(
            f"It takes {USUAL:g} minutes (minutes=N: another time); both at once: gsfw prepare "
            "INPUT out=DIR train=true minutes=N"
        )
