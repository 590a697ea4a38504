"""Similarity: the transform between the world of the data and the scene frame, in float64."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor


def _identity() -> Tensor:
    return torch.eye(3, dtype=torch.float64)


def _origin() -> Tensor:
    return torch.zeros(3, dtype=torch.float64)


@dataclass(frozen=True)
class Similarity:
    """y = scale * rotation @ x + translation, in float64.

    The scene frame is well conditioned (around the origin, of size about 1), so that float32 keeps
    centimetres of a georeferenced capture; every export applies the transform back.
    """

    scale: float = 1.0
    """Positive."""
    rotation: Float[Tensor, "3 3"] = field(default_factory=_identity)
    """A rotation matrix."""
    translation: Float[Tensor, " 3"] = field(default_factory=_origin)
    """In units of the frame that it leads to."""

    def apply(self, points: Float[Tensor, "*b 3"]) -> Float[Tensor, "*b 3"]:
        """Transform points; the result is float64."""
        return self.scale * (points.double() @ self.rotation.T) + self.translation

    def inverse(self) -> Similarity:
        """The inverse transform."""
        rotation = self.rotation.T
        return Similarity(1.0 / self.scale, rotation, -(rotation @ self.translation) / self.scale)

    def camera(self, world_to_camera: Float[Tensor, "*b 4 4"]) -> Float[Tensor, "*b 4 4"]:
        """Transform rigid camera transforms (float64) to the frame that this similarity leads to.

        Depths scale with the frame, so that images do not change.
        """
        pose = world_to_camera.double().clone()
        rotation = pose[..., :3, :3] @ self.rotation.T
        pose[..., :3, 3] = (
            self.scale * pose[..., :3, 3] - (rotation @ self.translation[:, None])[..., 0]
        )
        pose[..., :3, :3] = rotation
        return pose
