"""Background: the colour behind everything, as a setting."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gsfw.core.errors import ConfigError

if TYPE_CHECKING:
    import torch
    from torch import Tensor

AUTO = "auto"
"""White where images have alpha, else black."""

NAMED_BACKGROUNDS = {"white": (1.0, 1.0, 1.0), "black": (0.0, 0.0, 0.0)}


def parse_background(
    text: str, has_alpha: bool = False, key: str = "background"
) -> tuple[float, float, float]:
    """Parse a ``background`` setting: the colour in [0, 1] per channel.

    Args:
        text: the setting.
        has_alpha: true if images have alpha, which ``auto`` makes white.
        key: name of the setting, for messages.

    Raises:
        ConfigError: it is neither a name nor three numbers.
    """
    if text == AUTO:
        return NAMED_BACKGROUNDS["white" if has_alpha else "black"]
    if text in NAMED_BACKGROUNDS:
        return NAMED_BACKGROUNDS[text]
    try:
        red, green, blue = (float(part) for part in text.strip("[]() ").split(","))
    except ValueError:
        raise ConfigError(
            f"{key}={text}: expected white, black, auto, or three numbers such as 0.5,0.5,0.5."
        ) from None
    if not all(math.isfinite(value) for value in (red, green, blue)):
        raise ConfigError(f"{key}={text}: expected three finite numbers.")
    return red, green, blue


def background_tensor(
    background: str | Sequence[float] | Tensor | None,
    usual: Tensor | None = None,
    dtype: torch.dtype | None = None,
) -> Tensor | None:
    """A background as a tensor, by channel; one that is given as a tensor keeps its device.

    Args:
        background: as ``parse_background`` takes it, or a value for each channel; ``None`` for
            the usual one.
        usual: the usual one, which is returned as it is.
        dtype: of the result; ``None`` for float32.

    Raises:
        ConfigError: it is neither a name nor numbers.
    """
    import torch

    if background is None:
        return usual
    dtype = dtype or torch.float32
    if isinstance(background, str):
        return torch.tensor(parse_background(background), dtype=dtype)
    try:
        return torch.as_tensor(background, dtype=dtype).flatten()
    except (TypeError, ValueError, RuntimeError):
        raise ConfigError(
            f"background={background!r}: expected white, black, auto, or a number for each channel."
        ) from None
