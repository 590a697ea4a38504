"""Links: the place that a path leads to."""

import os
from pathlib import Path


def followed(path: Path) -> Path:
    """The absolute path without links; links that lead in circles stay.

    ``Path.resolve`` raises RuntimeError there before Python 3.13.
    """
    return Path(os.path.realpath(path))
