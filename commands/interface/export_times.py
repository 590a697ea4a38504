"""Export times: the times of a sequence of files, as ``times=TEXT`` asks for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gsfw.plugins.compose import Composition

ALL = "all"
"""The word for the times of the data."""


def parse_times(text: str, composition: Composition) -> tuple[float, ...]:
    """Parse ``times=TEXT``: times in [0, 1].

    Raises:
        ConfigError: it is neither a number nor ``all``, or the model is static.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.plugins.run_source import data_times, is_dynamic

    count = int(text) if text.isascii() and text.isdigit() else 0
    if text != ALL and count < 1:
        raise ConfigError(f"times={text}: expected a whole number of at least 1, or {ALL}.")
    if count == 1:
        return (0.0,)
    if not is_dynamic(composition):
        scene, method = composition.scene, composition.settings.method.name
        why = f"method {method} is static" if scene.is_dynamic else f"{scene.name} has no times"
        raise ConfigError(
            f"times={text}: {why}, so all files would be the same.", "Leave times out for one file."
        )
    if text == ALL:
        return data_times(composition)
    return tuple(index / (count - 1) for index in range(count))
