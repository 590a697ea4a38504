"""`gsfw check`: rates a data set for training, and names the remedies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.interface.arguments import FLAGS, Options, parse, positional, read_options
from gsfw.commands.interface.progress import loading_torch
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.progress import stage

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.plugins.settings import Settings
    from gsfw.preparation.check.examination import Examination

OWN = ("images", "out", *FLAGS)
"""Keys of this verb; all others are those of ``gsfw train``."""
ALL = "all"
CACHE_MB = 200
"""Decoded images that are kept, in megabytes: 60 of a megapixel."""
REFUSED = 1
"""Exit code of a data set that cannot be trained on."""


@dataclass(kw_only=True)
class CheckOptions(Options):
    """Say whether a data set is good enough to train on, without training.

    Besides the keys below it takes those of gsfw train: method, downscale, datamanager.masks, ...
    Exit codes: 0 good, or usable with limits; 1 will not train; 2 a mistake in the command.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw check path/to/capture",
        "gsfw check data=path/to/capture downscale=2 images=all out=capture.png",
        "gsfw check path/to/capture json=true",
    )

    what: str = positional("DATA", default="")
    """The data set, also as data=PATH."""
    images: str = ""
    """Number of images to decode, or all. Empty: 50, or 16 of videos."""
    out: str = "check.png"
    """File of the contact sheet; none: no sheet."""


def run(tokens: list[str]) -> int:
    """Examine a data set, and print the findings."""
    arguments = parse(tokens)
    own = [f"{key}={text}" for key, text in arguments.pairs if key in OWN]
    options = read_options("check", CheckOptions, [*own, *arguments.words])
    images = _images(options.images)
    given = [(key, text) for key, text in arguments.pairs if key not in OWN]
    with loading_torch(" and reading settings"):
        settings, given_values = _settings(options, given)

    from gsfw.commands.interface.console import Console

    console = Console(options.json)
    document = _check(console, options, settings, given_values, images)
    _show(console, document)
    console.result(document)
    return REFUSED if document["verdict"] == "will not train" else 0


def _images(text: str) -> int | None:
    """Number of images to decode; 0: all; ``None``: the default number.

    Raises:
        ConfigError: the text is neither a number nor "all".
    """
    if text in ("", ALL):
        return 0 if text else None
    if text.isdecimal() and int(text) > 0:
        return int(text)
    raise ConfigError(f"images={text}: expected a number of at least 1, or {ALL}.")


def _settings(
    options: CheckOptions, given: Sequence[tuple[str, str]]
) -> tuple[Settings, Mapping[str, str]]:
    """The settings of a training with these keys, and the keys.

    Raises:
        ConfigError: no data set is named, or two are, or a setting is wrong.
        DataError: the data set is missing, or of no known format.
    """
    from gsfw.commands.interface.arguments import Arguments, layers
    from gsfw.plugins.automatic import BUILT_IN_SCENE
    from gsfw.plugins.registry import installed
    from gsfw.plugins.settings import resolve

    values = dict(given)
    if options.what and values.get("data"):
        raise ConfigError(
            f"gsfw check: both {options.what} and data={values['data']} are given.",
            "Give one of them.",
        )
    if options.what:
        values = {"data": options.what, **values}
    named = values.get("data") or values.get("datamanager") == BUILT_IN_SCENE
    if not named and "config" not in values:
        raise ConfigError(
            "gsfw check: the data set is missing.", "Write gsfw check PATH; see --help."
        )
    pairs = [(key, text) for key, text in given if key not in ("data", "method")]
    if "data" in values:
        pairs.append(("data", values["data"]))
    method = values.get("method", "3dgs")
    settings = resolve(installed(), layers(Arguments((), (*pairs, ("method", method)))))
    return settings, values


def _check(
    console: Console,
    options: CheckOptions,
    settings: Settings,
    given: Mapping[str, str],
    images: int | None,
) -> dict[str, Any]:
    """Open the data set, examine it, and render the contact sheet; return the document.

    Findings are printed as they are found. A data set that cannot be opened has a document as well:
    it cannot be trained on.
    """
    from gsfw.commands.interface.fitness import misfits
    from gsfw.plugins.opening import open_data
    from gsfw.plugins.registry import installed
    from gsfw.preparation.check.examination import Examination
    from gsfw.preparation.check.report import finding_lines, report, report_unreadable
    from gsfw.preparation.finding import Finding

    def tell(finding: Finding) -> None:
        for line in finding_lines(finding.document()):
            console.say(line)

    settings.config.check()
    path, reader = settings.config.data, settings.choices["datamanager"].name
    head = {"kind": "check", "path": path, "format": reader}
    console.say(f"{path or 'the built-in scene'}: {reader}")
    try:
        with closing(open_data(_streaming(settings))) as data:
            # Only the method that was asked for is judged; else one that fits is suggested.
            known = misfits(settings, installed(), data) if "method" in given else ()
            examined = Examination.of(data, settings.config, images, tell, known)
    except DataError as error:
        document = report_unreadable(error)
        for line in (line for finding in document["findings"] for line in finding_lines(finding)):
            console.say(line)
        return {**head, **document, "next": "", "sheet": ""}
    sheet, problem = _draw(examined, options.out) if options.out != "none" else ("", "")
    plan = examined.plan(given.get("method", ""))
    length = _length(plan.settings(given))
    follows = plan.of_a_time() if length["next_minutes"] else plan
    following = {"next": follows.command(given), **length}
    document = {**head, **report(examined, plan), **following, "sheet": sheet}
    return {**document, "sheet_problem": problem} if problem else document


def _draw(examined: Examination, out: str) -> tuple[str, str]:
    """Draw the contact sheet; its place, and why that is another one than asked for."""
    from gsfw.core.files.elsewhere import write_here_or_elsewhere
    from gsfw.preparation.check.contact_sheet import COLUMNS, ROWS, tiles_of, write_contact_sheet
    from gsfw.preparation.finding import Verdict

    survey, findings = examined.survey, examined.findings
    tiles = tiles_of(survey, findings, COLUMNS * ROWS, COLUMNS)
    verdict, name = Verdict.of(findings), survey.scene.name
    with stage(f"drawing {out}"):
        return write_here_or_elsewhere(
            Path(out), lambda path: write_contact_sheet(path, name, verdict, survey, tiles)
        )


def _length(values: Mapping[str, str]) -> dict[str, float | None]:
    """Training steps of a command with these settings, or the minutes that it takes."""
    from gsfw.commands.interface.arguments import Arguments, layers
    from gsfw.planning.asked import asked_of, spelled_out
    from gsfw.plugins.registry import installed
    from gsfw.plugins.settings import resolve

    given = spelled_out(layers(Arguments((), tuple(values.items()))))
    settings = resolve(installed(), given)
    asked = asked_of(settings, given)
    if asked is None:
        return {"next_steps": settings.config.steps, "next_minutes": None}
    return {"next_steps": None, "next_minutes": asked.minutes}


def _streaming(settings: Settings) -> Settings:
    """Settings under which few decoded images are kept: each is looked at once or twice."""
    megabytes = min(settings.config.cache_mb, CACHE_MB)
    return replace(settings, config=replace(settings.config, cache_mb=megabytes))


def _show(console: Console, document: Mapping[str, Any]) -> None:
    """Print the summary after the findings: notes, a table, the verdict, the next command."""
    from gsfw.preparation.check.report import sample_line, table_rows, verdict_line

    console.say()
    for note in document.get("notes", ()):
        console.say(f"note: {note}")
    if "views_train" in document:
        console.table(["", ""], table_rows(document))
        console.say(sample_line(document))
        if document["view_dependence"]:
            console.say(document["view_dependence"]["advice"])
    console.say(verdict_line(document))
    if document["sheet"]:
        console.say(f"cameras, points and images: {document['sheet']}")
    if document.get("sheet_problem"):
        console.warn(document["sheet_problem"])
    if document["next"] and document["verdict"] != "will not train":
        console.say(f"next: {document['next']}")
        steps, minutes = document["next_steps"], document["next_minutes"]
        if steps is None:
            length = f"{minutes:g} minute{'' if minutes == 1 else 's'}"
            console.say(f"It trains for {length}. Add --dry-run to see the plan first.")
        else:
            length = f"{steps:,} steps"
            console.say(f"It trains for {length}. Add --dry-run to see how long they take here.")
