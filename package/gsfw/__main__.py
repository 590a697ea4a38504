"""The program ``gsfw``, which ``python -m gsfw`` runs, too."""

from __future__ import annotations

import gc
import os
import signal
import sys
from contextlib import suppress


def main() -> int:
    """Load and run the command line; return the exit code."""
    # There is nothing to clean up yet, or any more: Ctrl-C needs no exception with a traceback.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from gsfw.commands.main import main as run

    code = run()
    gc.freeze()  # The system takes all at once: there is no need to look for garbage at the end.
    return code


def _without_current_folder() -> None:
    """Take out the current folder, which ``-m`` puts first: the program gsfw does not search it.

    A folder there that is named like an installed package takes the package's place.
    """
    if getattr(sys.flags, "safe_path", False):  # From Python 3.11 on.
        return
    with suppress(OSError):  # The folder was removed.
        if sys.path[:1] == [os.getcwd()]:
            del sys.path[0]


if __name__ == "__main__":
    _without_current_folder()
    sys.exit(main())
