"""Contexts: a rendered batch of a step, for losses and refiners, and a rendered view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput
from gsfw.core.splats import Splats


@dataclass(frozen=True)
class StepContext:
    """One rendered batch of one step.

    All batches of a step are rendered before any of them is observed: the state of a batch belongs
    here, not into the model.
    """

    step: int
    """Number of the step, counted from 0."""
    steps: int
    """Length of the run."""
    batch: Batch
    """The images that were rendered, with cameras and maps."""
    splats: Splats
    """The rendered splats, still attached to the graph."""
    rendered: RenderOutput
    """Decoded images (``PrimitiveModel.decode``); the statistics are those of the rasterizer."""
    target: Float[Tensor, "c h w 3"]
    """The batch's images over this step's background."""
    num_rows: int
    """Number of rows of the model; ``splats.rows`` indexes them."""
    share: float
    """Fraction of the step's views that are in this batch: the weight of its loss."""
    extent: float
    """The scene's extent, in scene units."""
    operators: Operators
    """Native operations of the device, such as ``l1_dssim``."""
    render: Callable[[Cameras, Float[Tensor, ""] | None], RenderOutput]
    """Renders other cameras at a time with this step's settings and background: pseudo views for
    losses. Decoded, and attached to the graph; without statistics."""
    contributions: Callable[[Float[Tensor, "c h w 1"]], Float[Tensor, "c m"]]
    """Sums a weight per pixel, such as the error, over the contributions of each rendered splat
    (``Rasterizer.contributions``). To be called before the optimizer step, which moves the splats:
    in ``losses``, ``regularizers`` or ``before_backward``."""


@dataclass(frozen=True)
class ViewContext:
    """One rendered view, for the metrics and images of a method; without gradients."""

    batch: Batch
    """The view's image, with its camera and maps; ``c`` is 1."""
    rendered: RenderOutput
    """Decoded image (``PrimitiveModel.decode``), over the background of the run."""
    target: Float[Tensor, "1 h w 3"]
    """The image over the same background: what ``rendered.color`` is compared with."""
    extent: float
    """The scene's extent, in scene units."""
