"""gsfw: Gaussian splatting, static and dynamic.

    train       train a method on a data set; returns a Run
    open        a Run by its folder, a checkpoint in it, or "latest"
    load        a Model, from a file of splats, a model file or a run
    render      images of splats or of a Model; differentiable

    Run         a training: figures, evaluation, cameras, renders, export, resume
    Model       a trained model, or the splats of a file
    Cameras     poses and intrinsics; Cameras.look_at, Cameras.from_matrices
    Splats, Sh  Gaussians, and their view-dependent colours
    RenderOutput                color, alpha, depth of rendered images
    UserError                   base class of the next five
    ConfigError, DataError      a wrong setting; wrong data
    OutputError, TrainingError  results that cannot be written; a training that cannot continue
    UnavailableError            a part that cannot run on this machine

``help(gsfw.train)`` describes one. ``import gsfw`` imports no torch: these names are loaded when
they are first used. Plugins import from ``gsfw.api``, which has these names and all others, in
groups: ``help("gsfw.api.training")``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsfw.api.errors import ConfigError as ConfigError
    from gsfw.api.errors import DataError as DataError
    from gsfw.api.errors import OutputError as OutputError
    from gsfw.api.errors import TrainingError as TrainingError
    from gsfw.api.errors import UnavailableError as UnavailableError
    from gsfw.api.errors import UserError as UserError
    from gsfw.api.models import Model as Model
    from gsfw.api.models import load as load
    from gsfw.api.models import render as render
    from gsfw.api.rendering import Cameras as Cameras
    from gsfw.api.rendering import RenderOutput as RenderOutput
    from gsfw.api.rendering import Sh as Sh
    from gsfw.api.rendering import Splats as Splats
    from gsfw.api.runs import Run as Run
    from gsfw.api.runs import open as open
    from gsfw.api.runs import train as train

__version__ = "${version}"

_GROUPS = {
    "errors": (
        *("ConfigError", "DataError", "OutputError", "TrainingError", "UnavailableError"),
        "UserError",
    ),
    "models": ("Model", "load", "render"),
    "rendering": ("Cameras", "RenderOutput", "Sh", "Splats"),
    "runs": ("Run", "open", "train"),
}
"""The names, by the module of ``gsfw.api`` that has them."""


if not TYPE_CHECKING:  # A type checker would take any name for one of gsfw's.

    def __getattr__(name: str) -> object:
        """Import the name (PEP 562)."""
        for group, names in _GROUPS.items():
            if name in names:
                return getattr(import_module(f"gsfw.api.{group}"), name)
        raise AttributeError(f"module 'gsfw' has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names."""
    return sorted(["__version__", *(name for names in _GROUPS.values() for name in names)])
