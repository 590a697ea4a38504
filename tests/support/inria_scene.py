"""Eight splats and a camera, called as trainers of 3DGS call diff-gaussian-rasterization."""

from dataclasses import dataclass

import torch
from torch import Tensor

from gsfw.compat.diff_gaussian_rasterization import (
    GaussianRasterizationSettings,
    GaussianRasterizer,
)
from support import inria_formulas as original

WIDTH, HEIGHT = 22, 18
CLOSE = {"rtol": 1e-9, "atol": 1e-11}


@dataclass
class Scene:
    """Splats whose alpha is below 1 / 255 beyond three standard deviations."""

    means: Tensor
    opacities: Tensor
    shs: Tensor
    scales: Tensor
    rotations: Tensor

    def parameters(self) -> list[Tensor]:
        return list(vars(self).values())

    def covariances(self) -> Tensor:
        pairs = zip(self.scales, self.rotations, strict=True)
        return torch.stack([original.covariance_3d(s, r, 1.0) for s, r in pairs])

    def projected(self, settings: GaussianRasterizationSettings) -> original.Projected:
        pairs = zip(self.shs, self.means, strict=True)
        colors = torch.stack([original.color_of(sh, mean, settings) for sh, mean in pairs])
        return original.project(self.means, self.opacities, colors, self.covariances(), settings)


def small_camera() -> GaussianRasterizationSettings:
    return original.camera(WIDTH, HEIGHT)


def eight_splats() -> Scene:
    """Eight splats; the last is beyond 1.3 times the field of view, and large enough to be seen."""
    random = torch.Generator().manual_seed(3)

    def draw(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=random, dtype=torch.float64)

    means = (draw(8, 3) - 0.5) * torch.tensor([2.0, 1.6, 1.0])
    means[-1] = torch.tensor([3.0, 0.0, 0.0])
    scales = 0.05 + 0.3 * draw(8, 3)
    scales[-1] = 0.9
    # The original does not normalise quaternions: one is not of unit length.
    rotations = torch.nn.functional.normalize(draw(8, 4) - 0.5, dim=1)
    rotations[0] *= 1.1
    return Scene(means, 0.1 + 0.25 * draw(8, 1), draw(8, 4, 3) - 0.3, scales, rotations)


def with_gradients(scene: Scene) -> Scene:
    return Scene(*(tensor.clone().requires_grad_() for tensor in scene.parameters()))


def rendered(scene: Scene, settings: GaussianRasterizationSettings, **changed: Tensor):
    named = {
        "means3D": scene.means,
        "means2D": torch.zeros_like(scene.means),
        "opacities": scene.opacities,
        "shs": scene.shs,
        "scales": scene.scales,
        "rotations": scene.rotations,
    }
    return GaussianRasterizer(settings)(**(named | changed))


def weights(like: Tensor) -> Tensor:
    random = torch.Generator().manual_seed(1)
    return torch.randn(like.shape, generator=random, dtype=like.dtype)
