"""CaptureCorrections: what is learnt of the capture itself, whatever the method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jaxtyping import Float
from torch import Tensor, nn

from gsfw.core.loop.exposures import Exposures
from gsfw.core.loop.pose_refinement import PoseRefinement
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.render_output import RenderOutput


class CaptureCorrections(nn.Module):
    """Exposures of the pictures and poses of the cameras, each only where it was asked for.

    Poses reach everyone through the data manager (``RefinedCapture``); exposures are applied in
    training alone, because a held-out picture has none that is known.
    """

    def __init__(
        self, exposures: Exposures | None = None, poses: PoseRefinement | None = None
    ) -> None:
        super().__init__()
        self.exposures = exposures
        self.poses = poses

    def parameter_groups(self) -> tuple[ParameterGroup, ...]:
        """For the optimizer."""
        present = (part for part in (self.exposures, self.poses) if part is not None)
        return tuple(part.group() for part in present)

    def expose(
        self, rendered: RenderOutput, views: tuple[int, ...], background: Float[Tensor, " 3"]
    ) -> RenderOutput:
        """What training pictures should look like, by their index within the training split."""
        if self.exposures is None:
            return rendered
        return self.exposures.apply_to(rendered, views, background)

    def project_(self) -> None:
        """After each optimizer step: keep what nothing could tell apart where it is. In place."""
        for part in (self.exposures, self.poses):
            if part is not None:
                part.project_()

    def summary(self) -> Mapping[str, float]:
        """Figures for the run's summary; none where nothing is corrected."""
        figures: dict[str, float] = {}
        if self.exposures is not None:
            gains = self.exposures.matrices.diagonal(dim1=1, dim2=2).mean(dim=1)
            figures |= {"exposure_least": float(gains.min()), "exposure_most": float(gains.max())}
        if self.poses is not None:
            figures |= {"pose_degrees": self.poses.mean_angle, "pose_shift": self.poses.mean_shift}
        return figures

    def protocol(self) -> Mapping[str, str]:
        """What figures of held-out views have to say of it; nothing where nothing is corrected."""
        said: dict[str, str] = {}
        if self.exposures is not None:
            said["exposure"] = "learnt for training pictures, held-out ones are drawn without"
        if self.poses is not None:
            said["poses"] = "training cameras are refined, held-out ones stand as given"
        return said

    def load_state(self, checkpoint: Mapping[str, Any]) -> None:
        """Continue from a checkpoint; those of earlier versions correct nothing."""
        self.load_state_dict(checkpoint.get("corrections", {}))
