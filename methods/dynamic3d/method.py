"""Method dynamic3dgs: Luiten et al. 2024, "Dynamic 3D Gaussians".

Gaussians are trained on the images of the first time; on those of each later time they only move
and rotate (and change their constant colour a little), constrained to local rigidity.

Differences from the released code: masks of the foreground are optional, and without them all rows
take part in rigidity and there is no background term; rows learn their segmentation from the masks;
there is no floor term; colours have spherical harmonics; learning rates restart at every time and
decay within it, so that short runs converge like long ones; a body that turns is expected to turn
on, where the paper expects every row to go straight on.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import SEGMENTATION
from gsfw.core.context import StepContext, ViewContext
from gsfw.core.datamanager import Views
from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.optimizer import Optimizer
from gsfw.core.loop.recordable import graph_key
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.methods.dynamic3d.model import Regularization, TrackedGaussians
from gsfw.methods.dynamic3d.segmentation import (
    has_masks,
    intersection_over_union,
    mask_loss,
)
from gsfw.methods.moving.method import MovingMethod

if TYPE_CHECKING:
    from gsfw.methods.dynamic3d.config import TrackedGaussiansConfig

MASKS_NOTE = (
    "Views have masks of the foreground: rows learn whether they are foreground, and the others "
    "stay where they are at the first time. segmentation_weight=0 trains without masks."
)
ENOUGH_VIEWS = 4
"""Fewer views leave most of a surface to be seen from one side; Luiten et al. have 27 cameras."""
LEAST_VIEWS = 1.5
"""Training views at a time, on average, below which most times have one; of two cameras a hold-out
of every 8th image leaves 1.75."""
MOVING = ("means", "quats")
"""Columns whose moments are reset at every time."""


class TrackedGaussiansMethod(MovingMethod):
    """Trains the first time, then tracks through the others, in order."""

    def __init__(self, config: TrackedGaussiansConfig) -> None:
        super().__init__(config)
        self.config = config
        self._extent, self._num_times = 1.0, 0
        self._views_at: Mapping[float, int] = {}
        self._first_step: int | None = None
        self._planned_steps = 0
        self._has_masks = False
        self._tracked: TrackedGaussians | None = None
        """The model of the current step; ``None`` before the first."""

    def begin(self, scene: Scene, views: Views, model: PrimitiveModel) -> None:
        """Count the training views of each time; add the segmentation if views have masks.

        Raises:
            ConfigError: the masks have more than one channel.
        """
        self._views_at = dict(sorted(Counter(views.times or ()).items()))
        assert isinstance(model, TrackedGaussians)
        if self.config.segmentation_weight > 0 and has_masks(views):
            model.add_segmentation(LearningRate(self.config.optim.segmentation_lr))
            self._has_masks = True

    def check_scene(self, scene: Scene) -> None:
        """Refuse captures of one camera at each time: what moves has no depth to be followed in.

        Raises:
            ConfigError: names the remedy.
        """
        super().check_scene(scene)
        views = len(scene.camera_centers)
        if views < LEAST_VIEWS * scene.num_times:
            raise ConfigError(
                f"method 'dynamic3dgs' follows what several cameras see at each time, and "
                f"{scene.name!r} has {views} training views at {scene.num_times} times.",
                "Use method=4dgs, 4d-rotor or spacetime.",
            )

    def notes(self, scene: Scene) -> tuple[str, ...]:
        """Notes on the initialisation, and on times that the hold-out leaves with few views."""
        masks = (MASKS_NOTE,) if self._has_masks else ()
        return (*super().notes(scene), *view_notes(self._views_at), *masks)

    def losses(self, context: StepContext) -> Mapping[str, Tensor]:
        """L1 and SSIM of the images, and of the segmentation if there are masks."""
        losses = dict(super().losses(context))
        if self._has_masks:
            masks = mask_loss(context, self.config.ssim_weight)
            losses["segmentation"] = self.config.segmentation_weight * masks
        return losses

    def view_metrics(self, context: ViewContext) -> Mapping[str, float]:
        """Agreement of the rendered segmentation with the mask."""
        if not self._has_masks or SEGMENTATION not in context.batch.maps:
            return {}
        return {"segmentation_iou": intersection_over_union(context.batch, context.rendered)}

    def view_images(self, context: ViewContext) -> Mapping[str, Float[Tensor, "h w 3"]]:
        """The rendered segmentation in grey."""
        extra = context.rendered.extra
        if extra is None:
            return {}
        return {SEGMENTATION: extra[0].clamp(0.0, 1.0).expand(-1, -1, 3)}

    def build_model(
        self,
        scene: Scene,
        operators: Operators,
        generator: torch.Generator,
        initial: Splats | None,
    ) -> TrackedGaussians:
        """Build Gaussians from a file's splats, from points of the first time, or at random."""
        config = self.config
        self._extent, self._num_times = scene.extent, scene.num_times
        canonical = self.canonical.build_model(first_points(scene), operators, generator, initial)
        regularization = Regularization(
            config.rigid,
            config.rotation,
            config.isometry,
            config.color_change,
            config.background_weight,
            config.neighbors,
            config.neighbors_per_step,
        )
        return TrackedGaussians(canonical, regularization, operators, config.colors == "soft")

    def prepare(
        self, step: int, model: PrimitiveModel, optimizer: Optimizer, time: float | None
    ) -> None:
        """Start the next time with its first view; set rates, neighbours and the SH degree.

        Raises:
            ConfigError: the views are not in order of time.
        """
        assert isinstance(model, TrackedGaussians)
        assert time is not None
        self._tracked = model
        self.canonical.prepare(step, model.canonical, optimizer, time)
        current = model.trajectory.current
        if current is not None and time < current:
            raise ConfigError(
                f"method 'dynamic3dgs' follows a scene from each time to the next, but step "
                f"{step} shows time {time:.4g} after {current:.4g}: the sampler goes back.",
                "Use sampler=sequential, which is this method's own.",
            )
        if current is None or time > current:
            model.advance_(time)
            if model.tracking:
                self._start(step, model, optimizer)
        if self._first_step is not None:
            self._set_rates(model)
        if model.tracking:
            model.neighbors(step)

    def graph_key(self, step: int) -> Hashable | None:
        """The key of method 3dgs, the number of finished times, and that of neighbours."""
        own, model = graph_key(self.canonical, step), self._tracked
        if own is None or model is None:
            return None
        return own, model.trajectory.num_finished, model.num_neighbors(step)

    def _start(self, step: int, model: TrackedGaussians, optimizer: Optimizer) -> None:
        """Start to track a time.

        Its expected length is that of the previous time, for the first one an even share of the
        run: the number of trained times is unknown, as some may be held out.
        """
        if self._first_step is None:
            self._planned_steps = max((self.config.steps - step) // (self._num_times - 1), 1)
        else:
            self._planned_steps = step - self._first_step
        self._first_step = step
        optimizer.reset(MOVING)
        moving = {*MOVING, "sh_dc"} if self.config.colors == "soft" else {*MOVING}
        optimizer.freeze(model.columns().keys() - moving)

    def _set_rates(self, model: TrackedGaussians) -> None:
        """Learning rates of a step; they decay within a time, from its first view."""
        assert self._first_step is not None
        optim = self.config.optim
        for column, rate in (
            (model.canonical.means, optim.tracked_means_lr * self._extent),
            (model.canonical.quats, optim.tracked_quats_lr),
        ):
            column.learning_rate = LearningRate(
                rate, rate * optim.tracked_decay, self._planned_steps, self._first_step
            )

    def state_dict(self) -> dict[str, Any]:
        """The state of method 3dgs, and the first step of the current time."""
        return {
            **super().state_dict(),
            "first_step": self._first_step,
            "planned_steps": self._planned_steps,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from ``state``."""
        super().load_state_dict(state)
        self._first_step = state["first_step"]
        self._planned_steps = state["planned_steps"]


def view_notes(views_at: Mapping[float, int]) -> tuple[str, ...]:
    """Warnings about times with few training views, by the number of views at each time."""
    if not views_at:
        return ()
    counts, most, found = list(views_at.values()), max(views_at.values()), []
    remedy = (
        "Hold out whole cameras (datamanager.eval_cameras=NAME, holdout=NAMES) or fewer images "
        "(holdout_every=N)."
    )
    if counts[0] < most:
        found.append(
            f"method dynamic3dgs builds all Gaussians on the first time, which has {counts[0]} "
            f"training views where another time has {most}. {remedy}"
        )
    few = [time for time, count in views_at.items() if count < ENOUGH_VIEWS]
    if few:
        found.append(
            f"{len(few)} of {len(counts)} times have fewer than {ENOUGH_VIEWS} training views, the "
            f"first of them time {few[0]:.4g} with {views_at[few[0]]}: method dynamic3dgs follows "
            f"only what several views show. {remedy}"
        )
    return tuple(found)


def first_points(scene: Scene) -> Scene:
    """The scene with the points of its first time only, if points have capture times.

    The others may be elsewhere at the first time, and the training could not move them.
    """
    times = scene.point_times
    if times is None or not bool(times.isfinite().any()):
        return scene
    tolerance = 0.5 / max(scene.num_times - 1, 1)
    chosen: Tensor = times <= times[times.isfinite()].min() + tolerance
    return replace(
        scene,
        points=scene.points[chosen],
        point_colors=scene.point_colors[chosen],
        point_times=times[chosen],
    )
