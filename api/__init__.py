"""The public interface of gsfw: all names that plugins and programs may use.

``from gsfw.api import NAME`` works for every name of the modules here. Other modules of gsfw may
change in any release. A module is imported with the first of its names, so that ``Spec`` and
``hookimpl`` import no torch.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gsfw.api.configuration import *
    from gsfw.api.data import *
    from gsfw.api.errors import *
    from gsfw.api.files import *
    from gsfw.api.gaussians3d import *
    from gsfw.api.models import *
    from gsfw.api.registration import *
    from gsfw.api.rendering import *
    from gsfw.api.runs import *
    from gsfw.api.training import *
    from gsfw.api.verbs import *
    from gsfw.api.watching import *

GROUPS = (
    *("registration", "errors", "configuration", "training", "data", "rendering"),
    *("files", "watching", "verbs", "gaussians3d", "runs", "models"),
)
"""The modules of this folder, the light ones first."""


def __getattr__(name: str) -> Any:  # noqa: ANN401 - whatever the name stands for
    """Import the name from the first group that has it."""
    if not name.startswith("_"):
        for group in GROUPS:
            module = import_module(f"{__name__}.{group}")
            if name in module.__all__:
                return getattr(module, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """All public names."""
    groups = [import_module(f"{__name__}.{group}") for group in GROUPS]
    return sorted(name for group in groups for name in group.__all__)
