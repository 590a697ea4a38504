"""Exact: small pictures of the model in float64 by the reference, that errors are measured from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import Validation
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry
from gsfw.studies.tradeoff.subject import Subject, enlarged

REFERENCE = "reference"


@dataclass(frozen=True)
class PictureError:
    """How far pictures are from exact ones."""

    relative: float
    """Norm of the difference over the norm of the exact pictures."""
    largest: float
    """Largest difference of a colour."""


class Exact:
    """Pictures of the model as it is, drawn without error."""

    def __init__(self, subject: Subject, cameras: Sequence[Cameras], registry: Registry) -> None:
        """Draw them: by the reference rasterizer, in float64, with the settings of the run."""
        self.cameras = cameras
        config = load("rasterizer", registry.find("rasterizer", REFERENCE))()
        rasterizer = config.build(cameras[0].world_to_camera.device)
        self._exact = _pictures(
            replace(subject, rasterizer=rasterizer, dtype=torch.float64), cameras
        )

    def error(self, subject: Subject) -> PictureError:
        """How far a variant's pictures are from them.

        Raises:
            ValueError: its splats have values that cannot be drawn; says which.
        """
        settings = replace(subject.settings, validation=Validation.FULL)
        subject = replace(subject, settings=settings)
        difference = _pictures(subject, self.cameras) - self._exact
        relative = float(difference.norm() / self._exact.norm().clamp_min(1e-30))
        return PictureError(relative, float(difference.abs().max()))


def _pictures(subject: Subject, cameras: Sequence[Cameras]) -> Float[Tensor, " m"]:
    """All pixels of all pictures, one after the other, before any colour network; float64."""
    drawn = []
    for camera in cameras:
        splats = subject.splats(None if camera.time is None else camera.time[0])
        picture = subject.render(splats, camera).color[0].double()
        drawn.append(enlarged(picture, camera).flatten())
    return torch.cat(drawn)
