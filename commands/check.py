"""`gsfw check`: whether a data set is good enough to train on, and what to do if not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from gsfw.commands.arguments import FLAGS, Options, parse, read, word
from gsfw.core.errors import ConfigError, DataError
from gsfw.core.progress import stage

if TYPE_CHECKING:
    from gsfw.plugins.settings import Settings

OWN = ("pictures", "out", *FLAGS)
"""Keys of this verb; all others are those of ``gsfw train``."""
ALL = "all"
REFUSED = 1
"""Exit code of a data set that will not train."""


@dataclass(kw_only=True)
class CheckOptions(Options):
    """Say whether a data set is good enough to train on, without training.

    Besides the keys below it takes those of gsfw train: method, downscale, datamanager.masks, ...
    Exit codes: 0 good, or usable with limits; 1 will not train; 2 a mistake in the command.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw check path/to/capture",
        "gsfw check data=path/to/capture downscale=2 pictures=all out=capture.png",
        "gsfw check path/to/capture json=true",
    )

    what: str = word("DATA", default="")
    """The data set, also as data=PATH."""
    pictures: str = ""
    """How many pictures are decoded and looked at: a number, or all; empty: 50, of videos 16."""
    out: str = "check.png"
    """Where the contact sheet goes; none: nowhere."""


def run(tokens: list[str]) -> int:
    """Look at a data set, and say what was found."""
    arguments = parse(tokens)
    own = [f"{key}={text}" for key, text in arguments.pairs if key in OWN]
    options = read("check", CheckOptions, [*own, *arguments.words])
    pictures = _pictures(options.pictures)
    given = [(key, text) for key, text in arguments.pairs if key not in OWN]
    with stage("loading torch and reading settings"):
        settings, given_values = _settings(options, given)

    from gsfw.commands.check_report import tell
    from gsfw.commands.console import Console

    console = Console(options.json)
    with stage(f"examining {options.what or 'the data set'}"):
        document = _check(options, settings, given_values, pictures)
    tell(console, document)
    console.result(document)
    return REFUSED if document["verdict"] == "will not train" else 0


def _pictures(text: str) -> int | None:
    """How many to decode; 0: all; ``None``: the usual number.

    Raises:
        ConfigError: it is none of these.
    """
    if text in ("", ALL):
        return 0 if text else None
    if text.isdecimal() and int(text) > 0:
        return int(text)
    raise ConfigError(f"pictures={text}: expected a number of at least 1, or {ALL}.")


def _settings(
    options: CheckOptions, given: Sequence[tuple[str, str]]
) -> tuple[Settings, Mapping[str, str]]:
    """The settings that a training with these keys would have, and the keys.

    Raises:
        ConfigError: no data set is named, or two are, or a setting is wrong.
        DataError: the data set is not there, or of no known format.
    """
    from gsfw.commands.arguments import Arguments, layers
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
    options: CheckOptions,
    settings: Settings,
    given: Mapping[str, str],
    pictures: int | None,
) -> dict[str, Any]:
    """Open the data set, look at it, and draw the sheet; the document.

    What keeps a data set from being opened is a finding: it will not train.
    """
    from gsfw.commands.check_report import describe
    from gsfw.preparation.check.contact_sheet import COLUMNS, ROWS, write_contact_sheet
    from gsfw.preparation.check.examination import Examination
    from gsfw.preparation.check.plan import Plan
    from gsfw.preparation.check.tile import tiles_of
    from gsfw.preparation.finding import Verdict

    settings.config.check()
    path, reader = settings.config.data, settings.choices["datamanager"].name
    head = {"kind": "check", "path": path, "format": reader}
    try:
        examined = Examination.of(settings, pictures)
    except DataError as error:
        return {**head, **_unreadable(error)}
    survey, findings = examined.survey, examined.findings
    verdict = Verdict.of(findings)
    if options.out != "none":
        tiles = tiles_of(survey, findings, COLUMNS * ROWS, COLUMNS)
        write_contact_sheet(Path(options.out), survey.scene.name, verdict, survey, tiles)
    plan = Plan.of(survey, findings, settings.config, given.get("method", ""))
    return {
        **head,
        "verdict": verdict.value,
        **describe(survey, plan),
        "notes": list(examined.notes),
        "findings": [finding.document() for finding in findings],
        "next": plan.command(given),
        "sheet": "" if options.out == "none" else options.out,
    }


def _unreadable(error: DataError) -> dict[str, Any]:
    """The document of a data set that is recognised, and cannot be opened."""
    from gsfw.preparation.finding import Finding, Verdict, Weight

    finding = Finding(
        kind="cannot be read",
        weight=Weight.STOP,
        found=error.message,
        why="Training ends with this error.",
        advice=error.advice or "See gsfw info, and docs/data.md for what a format needs.",
    )
    verdict = Verdict.of([finding]).value
    return {"verdict": verdict, "findings": [finding.document()], "next": "", "sheet": ""}
