"""Replacement: other projects' modules give way to the interfaces here, by their own names."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import import_module

MODULES = {
    "diff_gaussian_rasterization": {"": "diff_gaussian_rasterization"},
    "simple_knn": {"": "simple_knn", "_C": "simple_knn._C"},
    "fused_ssim": {"": "fused_ssim"},
    "gsplat": {"": "gsplat", "rendering": "gsplat"},
}
"""Modules of each package, by their names inside it, and their stand-ins in gsfw.compat."""


@dataclass(frozen=True)
class Replacement:
    """Packages that were replaced, and that were not."""

    replaced: tuple[str, ...]
    kept: tuple[str, ...]
    """Packages that are installed and work on the GPU."""


def replace_modules(always: bool, gpu: bool) -> Replacement:
    """Put the interfaces of this package where scripts import those of other projects.

    Of an installed gsplat only ``rasterization`` is replaced, so that its strategies and
    optimizers stay.

    Args:
        always: also where the original can be imported.
        gpu: there is one. Without it everything is replaced: some originals can be imported, and
            fail at the first image.
    """
    kept = [] if always or not gpu else [name for name in MODULES if _importable(name)]
    replaced = [name for name in MODULES if name not in kept]
    for name in replaced:
        if name == "gsplat" and _importable(name):
            _replace_rasterization()
        else:
            _replace(name)
    return Replacement(tuple(replaced), tuple(kept))


def _importable(name: str) -> bool:
    """True if the original is installed for this machine; CUDA extensions may not load."""
    # simple_knn is a folder without __init__.py: the modules that scripts use decide.
    used = [f"{name}.{inside}" for inside in MODULES[name] if inside] or [name]
    try:
        found = [import_module(module) for module in used]
    except (ImportError, OSError):
        return False
    # A checkout's folder of submodules can pass for an empty package.
    return all(getattr(module, "__file__", None) is not None for module in found)


def _replace(name: str) -> None:
    for inside, here in MODULES[name].items():
        module = import_module(f"gsfw.compat.{here}")
        sys.modules[f"{name}.{inside}" if inside else name] = module


def _replace_rasterization() -> None:
    ours = import_module("gsfw.compat.gsplat").rasterization
    for name in ("gsplat", "gsplat.rendering"):
        import_module(name).rasterization = ours  # type: ignore[attr-defined]
