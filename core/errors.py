"""Errors with messages for the user."""


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


class ConfigError(UserError, ValueError):
    """A setting is unknown, has the wrong type, or contradicts another."""


class DataError(UserError, ValueError):
    """A data set or a file cannot be used."""


class OutputError(UserError):
    """The results cannot be written: the folder exists, is read-only, or the disk is full."""


class UnavailableError(UserError):
    """A component cannot run on this machine."""


class TrainingError(UserError):
    """Training cannot continue, for instance because its steps are no longer finite."""

    exit_code = 1
