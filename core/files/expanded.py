"""Expanded: the size of a YAML document whose aliases are written out, without doing so.

Ten short lines of aliases (``b: [*a, *a]``, ``c: [*b, *b]``, ...) stand for more values than memory
holds. They cost nothing as long as nobody goes through them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from gsfw.core.errors import ConfigError

MOST = 100_000
"""Values of a file of settings; a run has some hundred, and a study some thousand."""


def check_expanded(where: str, document: object) -> None:
    """Check that a document has a size that can be gone through.

    Args:
        where: the file, for the message.
        document: plain data of a YAML file.

    Raises:
        ConfigError: it has more than ``MOST`` values, or contains itself.
    """
    size = _size(document, {})
    if size > MOST:
        found = f"{size:,.0f} values" if size < 1e15 else "a number of values without end"
        raise ConfigError(
            f"{where}: its aliases (*name) stand for {found}, at most {MOST:,} are read.",
            "Write the values themselves.",
        )


def _size(item: object, known: dict[int, float]) -> float:
    """Number of values; infinite for one that contains itself."""
    if not isinstance(item, Mapping | list):
        return 1.0
    if id(item) not in known:
        known[id(item)] = math.inf  # Until it is known: whoever meets it again is inside of it.
        inner = item.values() if isinstance(item, Mapping) else item
        known[id(item)] = 1.0 + sum(_size(value, known) for value in inner)
    return known[id(item)]
