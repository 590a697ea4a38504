"""Views that were taken at given times, for tests of samplers."""

from collections.abc import Sequence
from dataclasses import replace

import torch

from gsfw.core.datamanager import Views
from support.scenes import front_camera


def timed_views(times: Sequence[float | None]) -> Views:
    """One view per time; ``None`` for views of a static capture."""
    cameras = tuple(
        replace(front_camera(), time=None if time is None else torch.tensor([time]))
        for time in times
    )
    return Views(tuple(f"{i}.png" for i in range(len(times))), cameras)
