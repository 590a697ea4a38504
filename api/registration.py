"""Registration: the record of a part, the marker of hooks, the version. Light to import."""

from gsfw.plugins.specs import Spec, hookimpl

API_VERSION = "1.0"
"""Version of this interface: a new name raises the second number, a removed one the first."""

__all__ = ["API_VERSION", "Spec", "hookimpl"]
