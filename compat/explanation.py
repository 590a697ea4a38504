"""Explanations of errors that end a script: the line of the script, the cause and the remedy."""

from __future__ import annotations

import re
import traceback
from dataclasses import dataclass
from pathlib import Path

import torch

from gsfw.api import UserError
from gsfw.compat.refusal import ELSEWHERE
from gsfw.compat.replacement import MODULES

PACKAGES = {
    "cv2": "opencv-python-headless",
    "PIL": "pillow",
    "pytorch_msssim": "pytorch-msssim",
    "skimage": "scikit-image",
    "sklearn": "scikit-learn",
    "torch_scatter": "torch-scatter --no-build-isolation",
    "yaml": "pyyaml",
}
"""Arguments of ``pip install`` for packages whose name is not that of their module."""
UNSUPPORTED = {
    "diff_surfel_rasterization": (
        "gsfw's rasterizers blend projected Gaussians, not surfels that a ray intersects (2DGS). "
        "Use the method of examples/2dgs (gsfw train method=2dgs), or a GPU and the original."
    ),
}
"""Rasterizers that other rasterizers cannot stand for, with the reason and the remedy."""
MOST_RESULTS = 3
"""Results of GaussianRasterizer: colour, radii, and the third image of some forks."""
WRONG_COUNT = re.compile(r"not enough values to unpack \(expected (\d+), got [23]\)")
GPU = re.compile(r"\b(CUDA|GPU|cuda|gpu)\b")
NO_NAME = re.compile(r"cannot import name '(\w+)' from 'gsfw\.compat\.([\w.]+)'")


@dataclass(frozen=True)
class Explanation:
    """A message that ends a run."""

    text: str
    exit_code: int
    traceback: bool = False
    """The error may have another cause, which the traceback shows."""


def explain(script: Path, error: Exception, claimed: bool = False) -> Explanation | None:
    """The explanation of an error; ``None`` for errors of the script's own code.

    Args:
        script: the script.
        error: ended it.
        claimed: it ran with ``--claim-gpu``.
    """
    place = _place(script, error)
    if isinstance(error, UserError):
        return Explanation(f"{place}: {error.message} {error.advice}", error.exit_code)
    if isinstance(error, ModuleNotFoundError) and error.name:
        return _explain_missing(place, error.name)
    if name := NO_NAME.search(str(error)):
        return _explain_lacking(place, f"{name[2]}.{name[1]}")
    if _wants_gpu(error) and not (claimed or torch.cuda.is_available()):
        text = "If this line requires a GPU, put --claim-gpu before the script."
        return Explanation(text, 1, traceback=True)
    if count := WRONG_COUNT.search(str(error)):
        return Explanation(_explain_count(int(count[1])), 1, traceback=True)
    return None


def _wants_gpu(error: Exception) -> bool:
    """True if a check for a GPU may have failed, by the text of the error, or by its line."""
    if not isinstance(error, AssertionError | RuntimeError):
        return False
    frames = traceback.extract_tb(error.__traceback__)
    text = str(error) or (frames[-1].line if frames else "")  # An assertion may have no text.
    return bool(GPU.search(text or ""))


def _explain_missing(place: str, name: str) -> Explanation:
    """The remedy for a module that cannot be imported."""
    package = name.split(".", maxsplit=1)[0]
    if package in UNSUPPORTED:
        return Explanation(
            f"{place}: gsfw.compat does not support the package {package!r}: "
            f"{UNSUPPORTED[package]}",
            2,
        )
    if name != package and package in MODULES:
        return _explain_lacking(place, name)
    if name != package:
        # The package is there; one of its modules is not.
        text = f"{package} has no module {name}: is this {package} the one that it needs?"
        return Explanation(text, 1, traceback=True)
    return Explanation(
        f"{place}: the package {package!r} is not installed. Install what the script's own "
        f"requirements name, or: pip install {PACKAGES.get(package, package)}. If this run only "
        f"imports the package, put --without {package} before the script.",
        2,
    )


def _explain_lacking(place: str, name: str) -> Explanation:
    """The remedy for a part of a replaced package that has no replacement."""
    advice = ELSEWHERE
    if name.startswith("gsplat."):
        advice = (
            "Install gsplat itself, of which gsfw.compat replaces three functions; "
            "python -c 'import gsplat' has to work."
        )
    return Explanation(f"{place}: gsfw.compat does not support {name}. {advice}", 2)


def _explain_count(expected: int) -> str:
    """The remedy for too few results."""
    if expected == MOST_RESULTS:
        return (
            "If this line calls GaussianRasterizer, its fork returns a third image: run with "
            "--third depth or --third invdepth."
        )
    return (
        f"If this line calls GaussianRasterizer, its fork returns {expected} results, which "
        "gsfw.compat does not support: use a GPU and the original package."
    )


def _place(script: Path, error: BaseException) -> str:
    """The line of the script's own code that led to an error."""
    folder = script.resolve().parent
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if folder in Path(frame.filename).resolve().parents]
    return f"{own[-1].filename}:{own[-1].lineno}" if own else str(script)
