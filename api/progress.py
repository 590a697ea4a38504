"""Progress: long work that the command line shows while it runs. Light to import.

Plugins never print. They wrap work that may take over a second in ``stage`` or ``tracked``.
"""

from gsfw.core.progress import stage, tracked

__all__ = [
    "stage",
    "tracked",
]
