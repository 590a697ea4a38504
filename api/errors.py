"""Errors: what a user can act on. Light to import.

Raise one of these with the cause and, as second argument, the remedy. The command line shows both
without a traceback. Any other exception is shown as a bug of the plugin.
"""

from gsfw.core.errors import (
    ConfigError,
    DataError,
    OutputError,
    TrainingError,
    UnavailableError,
    UserError,
)

__all__ = [
    "ConfigError",
    "DataError",
    "OutputError",
    "TrainingError",
    "UnavailableError",
    "UserError",
]
