"""Errors with messages for the user."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import wraps
from types import TracebackType
from typing import ParamSpec, TypeVar

Given = ParamSpec("Given")
Answer = TypeVar("Answer")

INNER_PACKAGES = frozenset({"gsfw", "torch", "jaxtyping", "beartype", *sys.stdlib_module_names})
"""Packages whose frames say nothing to those who call gsfw."""

COPY_AGAIN = "It may have been cut short or changed in copying; get it again."
"""The advice where a file is damaged."""


class EndedBySignal(SystemExit):
    """The program is ended by SIGTERM or SIGHUP: 128 and the number of the signal.

    Whoever handles the ``SystemExit`` of a plugin lets this one pass.
    """

    code: int


class UserError(Exception):
    """An error that the user can correct: shown as one message without a traceback, exit code 2.

    The message has the event, the place, the expected and the found value; ``advice`` has the
    next step of the user::

        raise ConfigError("feature_dim=8: the maps have 16 channels.", "Give feature_dim=16.")
    """

    exit_code = 2

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message if not advice else f"{message}\n{advice}")
        self.message = message
        self.advice = advice

    def __reduce__(self) -> tuple[Callable[..., UserError], tuple[object, ...]]:
        """Cross to another process with the texts alone, whatever a class is made of.

        An error that does not cross breaks a ``ProcessPoolExecutor``, and is never seen.
        """
        return _arrived, (type(self), self.message, self.advice)


def _arrived(kind: type[UserError], message: str, advice: str) -> UserError:
    """An error of another process."""
    error = kind.__new__(kind)
    UserError.__init__(error, message, advice)
    return error


class ConfigError(UserError, ValueError):
    """A setting is unknown, has the wrong type, or contradicts another."""


class DataError(UserError, ValueError):
    """A data set or a file cannot be used."""


class OutputError(UserError):
    """The results cannot be written: the folder exists, is read-only, or the disk is full."""


class UnavailableError(UserError):
    """A component cannot run on this machine."""


class NotEnoughMemoryError(UnavailableError):
    """A training needs more main memory than this machine, or its control group, has."""


class TrainingError(UserError):
    """Training cannot continue, for instance because its steps are no longer finite."""

    exit_code = 1


class LostProcessError(TrainingError):
    """Another process of the training has ended, or cannot be reached."""


class SilentProcessError(LostProcessError):
    """Another process of the training has not answered within the longest wait."""


def without_inner_frames(function: Callable[Given, Answer]) -> Callable[Given, Answer]:
    """Decorate a function for Python programs: a ``UserError`` shows no frames of gsfw.

    The message says what to do; the frames inside of gsfw would only hide the user's own line.
    Frames of callbacks and plugins stay, and so does the cause.
    """

    @wraps(function)
    def called(*args: Given.args, **kwargs: Given.kwargs) -> Answer:
        try:
            return function(*args, **kwargs)
        except UserError as error:
            frames = _foreign_frames(error.__traceback__)
            raise error.with_traceback(frames) from error.__cause__

    return called


def _foreign_frames(frames: TracebackType | None) -> TracebackType | None:
    """A traceback without the frames of gsfw and of what it calls itself with."""
    if frames is None:
        return None
    inner = _foreign_frames(frames.tb_next)
    module = str(frames.tb_frame.f_globals.get("__name__", ""))
    if module.partition(".")[0] in INNER_PACKAGES:
        return inner
    return TracebackType(inner, frames.tb_frame, frames.tb_lasti, frames.tb_lineno)
