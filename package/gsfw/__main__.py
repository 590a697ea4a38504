"""The program ``gsfw``, which ``python -m gsfw`` runs, too."""

from __future__ import annotations

import signal
import sys


def main() -> int:
    """Load and run the command line; return the exit code."""
    # There is nothing to clean up yet, or any more: Ctrl-C needs no exception with a traceback.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from gsfw.commands.main import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())
