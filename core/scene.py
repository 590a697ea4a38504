"""Scene: what is known of a capture before training."""

from __future__ import annotations

from dataclasses import dataclass, field

from jaxtyping import Float
from torch import Tensor

from gsfw.core.maths.similarity import Similarity


@dataclass(frozen=True)
class Scene:
    """What a method may know before training; lengths are in scene units."""

    name: str
    points: Float[Tensor, "p 3"]
    """Surface points in the scene frame; [0, 3] when the data set has none."""
    point_colors: Float[Tensor, "p 3"]
    """Their colours in [0, 1]."""
    camera_centers: Float[Tensor, "v 3"]
    """Positions of the training cameras in the scene frame."""
    extent: float
    """1.1 times the largest distance of a training camera from their mean; learning rates of
    positions are multiplied by it. Positive."""
    world_from_scene: Similarity = field(default_factory=Similarity)
    """Leads from the scene frame back to the world of the data; every export goes through it."""
    point_times: Float[Tensor, " p"] | None = None
    """When each point was seen, in [0, 1], finite; ``None`` when unknown or static."""
    time_range: tuple[float, float] | None = None
    """First and last capture time in seconds (or in the data's own unit); ``None`` if static."""
    num_times: int = 0
    """Number of distinct capture times; 0 for a static capture."""
    has_alpha: bool = False
    """Whether images carry an alpha channel."""
    up: str = ""
    """Which way is up in the data's world ("z", "-y"); empty when unknown. Exports say it."""
    camera_axes: Float[Tensor, "v 3"] | None = None
    """Unit vectors along which the training cameras look; ``None`` when nobody said."""

    @property
    def is_dynamic(self) -> bool:
        """Whether the capture shows more than one time."""
        return self.num_times > 1
