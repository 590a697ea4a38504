"""Errors: what a user can act on; shown without a traceback. Light to import."""

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
