"""FLIP: visible difference of two images that are shown in turn; the lower the better.

P. Andersson, J. Nilsson, T. Akenine-Moeller, M. Oskarsson, K. Astrom, M. D. Fairchild: FLIP: A
Difference Evaluator for Alternating Images (HPG 2020). Measured by its authors' package
flip-evaluator, at its 67 pixels per degree, which is a 0.7 m wide 4K screen 0.7 m away.
"""

from __future__ import annotations

from importlib import import_module

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

PACKAGE = "flip_evaluator"


def unavailable() -> str:
    """The reason why FLIP cannot be measured, and the remedy; empty if it can."""
    try:
        import_module(PACKAGE)
    except ModuleNotFoundError:
        return "flip-evaluator is not installed; pip install 'gsfw[flip]'"
    except ImportError as error:
        return (
            f"flip-evaluator cannot be loaded ({error}); "
            "pip install --force-reinstall flip-evaluator"
        )
    return ""


def flip_map(
    rendered: Float[Tensor, "h w 3"],
    target: Float[Tensor, "h w 3"],
    valid: Bool[Tensor, "h w 1"] | None = None,
) -> Float[Tensor, "h w 1"]:
    """FLIP of each pixel, in [0, 1]: 0 for equal images; on the CPU.

    Pixels that are not valid take the target's value first, so that they do not disturb their
    neighbours. Colours are sRGB, and clamped to [0, 1].
    """
    if valid is not None:
        rendered = torch.where(valid, rendered, target)
    error, _, _ = import_module(PACKAGE).evaluate(
        _pixels(target),
        _pixels(rendered),
        "LDR",
        inputsRGB=True,
        applyMagma=False,
        computeMeanError=False,
    )
    return torch.from_numpy(error)


def _pixels(image: Float[Tensor, "h w 3"]) -> Float[np.ndarray, "h w 3"]:
    return image.float().clamp(0, 1).cpu().contiguous().numpy()
