"""Parent process: its end is also that of the processes that work for it."""

from __future__ import annotations

import multiprocessing
import os
from threading import Thread


def end_with_parent() -> None:
    """End this process when its parent has ended, also by force.

    By itself a process of a pool would wait for work for ever, since it holds both ends of the
    queue that it is given work by.
    """

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    Thread(target=watch, daemon=True).start()
