"""The public interface of gsfw: all names that plugins and programs may use.

``from gsfw.api import NAME`` works for every name of the modules here. Other modules of gsfw may
change in any release. A module is imported with the first of its names: registration, errors,
progress and configuration need no torch.

Versions. ``API_VERSION`` is the version of this interface, not that of gsfw. The second number
grows with every addition: a new name, an optional argument or field, a method that has a default.
The first number grows when a plugin may have to change: a name is removed, or a signature, a
required method or the meaning of a value is another. A plugin states the versions that it was made
for in the hook ``gsfw_requires_api``, such as ">=1.0,<2"; gsfw skips it, with one sentence, where
the version lies outside.

Deprecation. What is renamed or replaced keeps working, with one ``DeprecationWarning`` that names
the replacement, since when, and the version that removes it: at the earliest the next first number,
and not before the warning has been in two releases of gsfw. Nothing is removed without a warning,
and no default of a setting changes in a way that old runs would be read differently. A file of the
tests lists all names and signatures, so that none changes by accident.
"""

from __future__ import annotations

import sys
import warnings
from importlib import import_module
from typing import TYPE_CHECKING, Any

from gsfw.api.deprecation import DEPRECATED

if TYPE_CHECKING:
    from gsfw.api.configuration import *
    from gsfw.api.data import *
    from gsfw.api.errors import *
    from gsfw.api.files import *
    from gsfw.api.gaussians3d import *
    from gsfw.api.operators import *
    from gsfw.api.progress import *
    from gsfw.api.registration import *
    from gsfw.api.rendering import *
    from gsfw.api.training import *
    from gsfw.api.verbs import *
    from gsfw.api.watching import *

GROUPS = (
    *("registration", "errors", "progress", "configuration", "rendering", "training", "watching"),
    *("operators", "files", "data", "gaussians3d", "verbs"),
)
"""The modules of this folder, the light ones first."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    """Import the name from the first group that has it."""
    if name in DEPRECATED:
        # "from gsfw.api import NAME" asks twice: importlib for its existence, then the statement.
        if "importlib" not in sys._getframe(1).f_code.co_filename:
            warnings.warn(DEPRECATED[name].message(name), DeprecationWarning, stacklevel=2)
        name = DEPRECATED[name].replacement
    if not name.startswith("_"):
        for group in GROUPS:
            module = import_module(f"{__name__}.{group}")
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """All public names, without the deprecated ones."""
    groups = [import_module(f"{__name__}.{group}") for group in GROUPS]
    return sorted(name for group in groups for name in group.__all__)
