"""CaptureCorrections: trained corrections of the capture itself, for any method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

from gsfw.core.batch import Batch
from gsfw.core.loop.exposures import Exposures
from gsfw.core.loop.pose_refinement import PoseRefinement
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.render_output import RenderOutput


class CaptureCorrections(nn.Module):
    """Exposures of the images and poses of the cameras, each only if requested.

    All components read poses from the data manager (``RefinedCapture``), but for the steps, which
    refine them with a gradient; exposures are applied in training alone, because those of held-out
    images are unknown. Steps find both by the numbers of their views on the device.
    """

    _numbers: Tensor

    def __init__(
        self, exposures: Exposures | None = None, poses: PoseRefinement | None = None
    ) -> None:
        super().__init__()
        self.exposures = exposures
        self.poses = poses
        views = 0 if poses is None else len(poses.rows)
        views = views if exposures is None else len(exposures.names)
        self.register_buffer("_numbers", torch.arange(views), persistent=False)

    def numbered(self, batch: Batch) -> Batch:
        """A batch of training views with their numbers on the device, if any are corrected.

        The host sends nothing there, and waits for nothing.
        """
        if not len(self._numbers):
            return batch
        numbers = torch.cat([self._numbers[view : view + 1] for view in batch.views])
        return replace(batch, numbers=numbers)

    def refined(self, batch: Batch) -> Batch:
        """The same batch with refined cameras, which have a gradient."""
        if self.poses is None:
            return batch
        assert batch.numbers is not None
        return replace(batch, cameras=self.poses.refine_by_number(batch.cameras, batch.numbers))

    def parameter_groups(self) -> tuple[ParameterGroup, ...]:
        """Parameter groups for the optimizer."""
        present = (part for part in (self.exposures, self.poses) if part is not None)
        return tuple(part.group() for part in present)

    def expose(
        self, rendered: RenderOutput, batch: Batch, background: Float[Tensor, " 3"]
    ) -> RenderOutput:
        """Apply the exposures of the images of a batch."""
        if self.exposures is None:
            return rendered
        assert batch.numbers is not None
        return self.exposures.apply_to(rendered, batch.numbers, background)

    def project_(self) -> None:
        """Remove unobservable common corrections after each optimizer step. In place."""
        for part in (self.exposures, self.poses):
            if part is not None:
                part.project_()

    def summary(self) -> Mapping[str, float]:
        """Figures for the run's summary; empty if nothing is corrected."""
        figures: dict[str, float] = {}
        if self.exposures is not None:
            gains = self.exposures.matrices.diagonal(dim1=1, dim2=2).mean(dim=1)
            figures |= {"exposure_least": float(gains.min()), "exposure_most": float(gains.max())}
        if self.poses is not None:
            figures |= {"pose_degrees": self.poses.mean_angle, "pose_shift": self.poses.mean_shift}
        return figures

    def protocol(self) -> Mapping[str, str]:
        """Notes on the corrections, for held-out figures; empty if nothing is corrected."""
        said: dict[str, str] = {}
        if self.exposures is not None:
            said["exposure"] = "learnt for training images; held-out images are rendered without it"
        if self.poses is not None:
            said["poses"] = "training cameras are refined, held-out cameras stay as given"
        return said

    def load_state(self, checkpoint: Mapping[str, Any]) -> None:
        """Continue from a checkpoint; those of earlier versions have no corrections."""
        self.load_state_dict(checkpoint.get("corrections", {}))
