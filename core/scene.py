"""Scene: the facts about a capture before training."""

from __future__ import annotations

from dataclasses import dataclass, field

from jaxtyping import Float
from torch import Tensor

from gsfw.core.maths.similarity import Similarity
from gsfw.core.sky import Sky


@dataclass(frozen=True)
class Scene:
    """Facts about a capture for the method before training; lengths are in scene units."""

    name: str
    """Name for folders and messages."""
    points: Float[Tensor, "p 3"]
    """Surface points in the scene frame; [0, 3] when the data set has none."""
    point_colors: Float[Tensor, "p 3"]
    """Colours of the points in [0, 1]."""
    camera_centers: Float[Tensor, "v 3"]
    """Positions of the training cameras in the scene frame."""
    extent: float
    """1.1 times the largest distance of a training camera from their mean; learning rates of
    positions are multiplied by it. Positive."""
    world_from_scene: Similarity = field(default_factory=Similarity)
    """Transform from the scene frame back to the world of the data; every export applies it."""
    point_times: Float[Tensor, " p"] | None = None
    """Capture time of each point, in [0, 1], finite; ``None`` when unknown or static."""
    time_range: tuple[float, float] | None = None
    """First and last capture time in seconds (or in the data's own unit); ``None`` if static."""
    num_times: int = 0
    """Number of distinct capture times; 0 for a static capture."""
    has_alpha: bool = False
    """True if images have an alpha channel."""
    up: str = ""
    """Up direction in the data's world ("z", "-y"); empty when unknown. Written into exports."""
    camera_axes: Float[Tensor, "v 3"] | None = None
    """Unit vectors of the training cameras' viewing directions; ``None`` when unknown."""
    view_pixels: int = 0
    """Pixels of a training view at the size it is trained on, as a median; 0 when unknown."""
    sky: Sky | None = None
    """The sphere of the sky under ``sky=true``, else ``None``; without points where none are to be
    added: none was found, a file brings the splats, or a checkpoint follows."""

    @property
    def is_dynamic(self) -> bool:
        """True if the capture has more than one time."""
        return self.num_times > 1
