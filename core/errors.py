"""Errors whose text is written for the person at the keyboard."""


class UserError(Exception):
    """Something the user can put right: shown as one message, without a traceback, exit code 2.

    The message says what happened, where, what was expected and what was found; ``advice`` says
    what to do next.
    """

    exit_code = 2

    def __init__(self, message: str, advice: str = "") -> None:
        super().__init__(message if not advice else f"{message}\n{advice}")
        self.message = message
        self.advice = advice


class ConfigError(UserError, ValueError):
    """A setting is unknown, has the wrong type, or does not go with the others."""


class DataError(UserError, ValueError):
    """A data set or a file cannot be used as it is."""


class OutputError(UserError):
    """The results cannot be written: the folder exists, is read-only, or the disk is full."""


class UnavailableError(UserError):
    """A component cannot run on this machine."""


class TrainingError(UserError):
    """Training cannot go on, for instance because its steps are no longer finite."""

    exit_code = 1
