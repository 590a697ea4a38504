"""Replacement: other projects' modules give way to the interfaces here, by their own names."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import import_module

MODULES = {
    "diff_gaussian_rasterization": {"": "diff_gaussian_rasterization"},
    "simple_knn": {"": "simple_knn", "_C": "simple_knn._C"},
    "fused_ssim": {"": "fused_ssim"},
    "gsplat": {"": "gsplat", "rendering": "gsplat", "relocation": "gsplat_relocation"},
}
"""Modules of each package, by their names inside it, and their stand-ins in gsfw.compat."""

DECISIVE = {"simple_knn": "simple_knn._C", "gsplat": "gsplat.rendering"}
"""The module of a package that every script needs, if the package itself is not enough: simple_knn
is a folder without __init__.py, and versions of gsplat before 1.0 have no relocation."""
IN_GSPLAT = (
    *((module, "rasterization", "gsplat") for module in ("gsplat", "gsplat.rendering")),
    *(
        (module, "compute_relocation", "gsplat_relocation")
        for module in ("gsplat.relocation", "gsplat.strategy.ops")
    ),
    *(
        (module, "quat_scale_to_covar_preci", "gsplat_covariances")
        for module in ("gsplat", "gsplat.strategy.ops")
    ),
)
"""Functions of an installed gsplat that are replaced: module, name, and module in gsfw.compat."""


@dataclass(frozen=True)
class Replacement:
    """Packages that were replaced, and that were not."""

    replaced: tuple[str, ...]
    kept: tuple[str, ...]
    """Packages that are installed and work on the GPU."""


def replace_modules(always: bool, gpu: bool) -> Replacement:
    """Put the interfaces of this package where scripts import those of other projects.

    Of an installed gsplat only ``rasterization`` and two functions of its strategies are replaced,
    so that these and its optimizers stay.

    Args:
        always: also where the original can be imported.
        gpu: there is one. Without it everything is replaced: some originals can be imported, and
            fail at the first image.

    Raises:
        ModuleNotFoundError: a module of the installed gsplat lacks another package.
    """
    kept = [] if always or not gpu else [name for name in MODULES if _importable(name)]
    replaced = [name for name in MODULES if name not in kept]
    for name in replaced:
        if name == "gsplat" and _importable(name):
            _replace_in_gsplat()
        else:
            _replace(name)
    return Replacement(tuple(replaced), tuple(kept))


def _importable(name: str) -> bool:
    """True if the original is installed for this machine; CUDA extensions may not load."""
    try:
        module = import_module(DECISIVE.get(name, name))
    except (ImportError, OSError):
        return False
    # A checkout's folder of submodules can pass for an empty package.
    return getattr(module, "__file__", None) is not None


def _replace(name: str) -> None:
    for inside, here in MODULES[name].items():
        module = import_module(f"gsfw.compat.{here}")
        sys.modules[f"{name}.{inside}" if inside else name] = module


def _replace_in_gsplat() -> None:
    for place, name, here in IN_GSPLAT:
        try:
            module = import_module(place)
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != "gsplat":
                raise  # It is there, and lacks another package.
            continue
        setattr(module, name, getattr(import_module(f"gsfw.compat.{here}"), name))
