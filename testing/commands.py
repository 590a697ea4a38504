"""Promises of verbs: help, and mistakes that end in a message."""

from __future__ import annotations

import contextlib
import io

from gsfw.commands.interface.arguments import HelpRequested
from gsfw.core.errors import UserError
from gsfw.testing.promise import Promise, require
from gsfw.testing.subject import Subject

NO_SETTING = "there-is-no-such-setting=1"
"""A mistake in any command."""


def _ends_by(subject: Subject, *arguments: str) -> tuple[object, str]:
    """The result or the error of a verb, and its printed text."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        try:
            ending: object = subject.target([*arguments])
        except (Exception, SystemExit) as error:
            ending = error
    return ending, printed.getvalue()


def _help_is_shown(subject: Subject) -> None:
    ending, printed = _ends_by(subject, "--help")
    text = str(ending) if isinstance(ending, HelpRequested) else printed
    require(
        len(text.split()) > 1 and isinstance(ending, HelpRequested | int),
        f"--help ends in {type(ending).__name__} ({ending}), with the text {text!r}.",
        f"Read the arguments with read({subject.name!r}, MyOptions, arguments) of gsfw.api.",
    )


def _mistakes_are_messages(subject: Subject) -> None:
    ending, _ = _ends_by(subject, NO_SETTING)
    require(
        isinstance(ending, UserError) or (isinstance(ending, int) and ending != 0),
        f"{NO_SETTING} ends in {type(ending).__name__}: {ending}.",
        "Refuse unknown settings with ConfigError: read(...) of gsfw.api does so.",
    )


PROMISES = (
    Promise("shows-help", "--help explains the verb.", _help_is_shown),
    Promise(
        "mistakes-are-messages",
        "An unknown setting is refused with a ConfigError, without a traceback.",
        _mistakes_are_messages,
    ),
)
