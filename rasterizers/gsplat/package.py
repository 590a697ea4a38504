"""Package: the gsplat that is installed: which one, how it renders, and why it cannot."""

from __future__ import annotations

import logging
import re
from importlib import import_module, metadata
from typing import Any

import torch

from gsfw.core.errors import UnavailableError
from gsfw.core.numerics import DEFAULT, GSPLAT_1_5, NumericsProfile

LEAST = (1, 5, 3)
"""The first version whose ``rasterization`` is as this adapter calls it."""

CLAMPS_EARLIER = (1, 6)
"""From here on alpha is clamped at 0.99, and the antialiasing compensation at 0.005."""

LOGGER = logging.getLogger(__name__)


def version() -> str:
    """The installed version; empty where there is none. Does not import it."""
    try:
        return metadata.version("gsplat")
    except metadata.PackageNotFoundError:
        return ""


def profile(installed: str) -> NumericsProfile:
    """The constants that a version renders with."""
    return DEFAULT if _numbers(installed) >= CLAMPS_EARLIER else GSPLAT_1_5


def unavailable() -> str:
    """The reason why gsplat cannot render here, and the remedy; empty if none is known."""
    if torch.version.cuda is None:
        return "this torch is built without CUDA, which gsplat needs; see pytorch.org for another"
    if not torch.cuda.is_available():
        return "torch sees no GPU here, and gsplat renders on nothing else; use a machine with one"
    installed = version()
    if not installed:
        return "gsplat is not installed; pip install 'gsfw[gsplat]'"
    if _numbers(installed) < LEAST:
        least = ".".join(map(str, LEAST))
        return f"gsplat {installed} is older than {least}; pip install --upgrade 'gsfw[gsplat]'"
    return ""


def load() -> Any:  # noqa: ANN401 - a module without types
    """Import gsplat and its kernels.

    Raises:
        UnavailableError: gsplat or its kernels do not load; says which, and what to do.
    """
    installed = version()
    LOGGER.info(
        "loading gsplat %s; unless its wheel has them, it compiles its kernels first, which takes "
        "minutes",
        installed,
    )
    try:
        package = import_module("gsplat")
        kernels = import_module("gsplat.cuda._backend")._C
    except Exception as error:  # Whatever a compiler, a linker or a loader comes up with.
        reason = str(error).strip().partition("\n")[0]
        raise UnavailableError(
            f"gsplat {installed} cannot be loaded: {type(error).__name__}: {reason}",
            "Install a wheel for this torch and CUDA (docs.gsplat.studio/whl), or render with "
            "rasterizer=auto.",
        ) from error
    if kernels is None:  # Without a compiler it says so on the terminal, and goes on.
        raise UnavailableError(
            f"gsplat {installed} came without compiled kernels, and found no CUDA toolkit (nvcc) "
            "to compile them with.",
            "Install a wheel for this torch and CUDA (docs.gsplat.studio/whl) or the toolkit, or "
            "render with rasterizer=auto.",
        )
    return package


def _numbers(installed: str) -> tuple[int, ...]:
    """The release in a version such as 1.5.3+pt24cu124."""
    release = re.match(r"\d+(\.\d+)*", installed)
    return tuple(map(int, release[0].split("."))) if release else ()
