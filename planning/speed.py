"""Speed: how many updates a time allows, by image size, from the figures of a trial."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from gsfw.core.loop.timekeeper import Ending

PIXELS_EXPONENT = 0.8
"""Exponent of the time of a step in the number of pixels, about: between images of 30,000 and
230,000 pixels with the Gaussians that they need."""
ENDING = Ending(updates=80.0, seconds=1.6)
"""Work after the last step: requirements and report; matplotlib, files, the end of the process.
Measured: fox at 180 x 320, 400 steps."""

CALLBACKS, EVALUATED = 3.0, 16.0
"""Time of a held-out view over that of rendering and comparing it: images for TensorBoard; and the
rest of an evaluation in such times: training views, baselines, a checkpoint."""


@dataclass(frozen=True)
class Speed:
    """Times of a run on this machine, in seconds."""

    downscale: float
    """Divisor of the images that were measured."""
    pixels: int
    """Pixels of such an image."""
    gaussians: int
    """Rows of the model that was measured."""
    state_bytes: float
    """Bytes of its checkpoint."""
    before: float
    """From the start of the command to the first step, once the plan is made."""
    step: float
    view: float
    """Rendering one view and comparing it."""
    load: float
    """Decoding one view, with all threads at work."""
    views: int
    """Views that are decoded: those to train on and the held-out ones."""
    held_out: int
    mean_cost: float = 1.0
    """Mean time of a step of the run over that of its first ones, as models grow and images do."""
    busy: float = 1.0
    """Wall-clock time over the time that the machine would need if it did nothing else."""

    def cost(self, downscale: float) -> float:
        """Factor of the time of a step at another divisor of the images."""
        return (self.downscale / downscale) ** (2 * PIXELS_EXPONENT)

    def view_pixels(self, downscale: float) -> int:
        """Pixels of an image at another divisor."""
        return round(self.pixels * (self.downscale / downscale) ** 2)

    def around(self, downscale: float) -> float:
        """Seconds of all that is not training."""
        cost = self.cost(downscale)
        ending = ENDING.updates * self.step * cost + ENDING.seconds * self.busy
        return self.before + self.load * self.views + self.evaluation(downscale) + ending

    def evaluation(self, downscale: float) -> float:
        """Seconds of an evaluation on the way."""
        return (CALLBACKS * self.held_out + EVALUATED) * self.view * self.cost(downscale)

    def updates(self, limit: float, downscale: float) -> float:
        """Updates that a run of ``limit`` seconds has; none or fewer if the time is too short."""
        return (limit - self.around(downscale)) / (self.mean_step * self.cost(downscale))

    def seconds(self, updates: float, downscale: float) -> float:
        """Seconds of a run of ``updates`` updates."""
        return self.around(downscale) + updates * self.mean_step * self.cost(downscale)

    @property
    def mean_step(self) -> float:
        """Seconds of a step of the whole run, in the mean."""
        return self.mean_cost * self.step

    def least_minutes(self, downscale: float) -> float:
        """Minutes of which half are training."""
        return math.ceil(2 * self.around(downscale) / 60)

    def document(self) -> dict[str, float]:
        """Plain data for the record of a plan."""
        return asdict(self)
