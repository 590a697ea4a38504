"""Number of threads that native code may use."""

from __future__ import annotations

import torch

from gsfw.core.cores import affinity, chosen_threads, cores


def num_threads() -> int:
    """Threads to use now, at least 1.

    As many as torch would use (``torch.set_num_threads`` and ``OMP_NUM_THREADS`` set that), but no
    more than the cores that this process may run on, nor, unless the user set ``OMP_NUM_THREADS``,
    than a container's share of CPU time is worth.
    """
    available = cores() if chosen_threads() is None else affinity()
    return max(1, min(torch.get_num_threads(), available))
