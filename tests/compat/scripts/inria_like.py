"""A small trainer with the calls of those that grew from the original one, for CUDA as it says.

python -m gsfw.compat inria_like.py STEPS
"""

# ruff: noqa: T201
import math
import sys

import torch
from diff_gaussian_rasterization import GaussianRasterizationSettings, GaussianRasterizer
from fused_ssim import fused_ssim
from simple_knn._C import distCUDA2
from targets import cameras, targets
from torch import nn

THRESHOLD = 2e-4


class Gaussians:
    """Points with an optimizer, cloned where viewspace gradients are large."""

    def __init__(self, points: torch.Tensor) -> None:
        places, count = points.to("cuda"), len(points)
        spacing = distCUDA2(places).clamp(min=1e-8).sqrt()
        self.parameters = {
            "xyz": places,
            "features": torch.zeros(count, 4, 3, device="cuda"),
            "scaling": spacing.log().unsqueeze(1).expand(count, 3).clone(),
            "rotation": torch.eye(4, device="cuda")[:1].repeat(count, 1),
            "opacity": torch.zeros(count, 1, device="cuda"),
        }
        self.train()

    def train(self) -> None:
        """Make parameters of the tensors, and an optimizer."""
        self.parameters = {k: nn.Parameter(v.detach()) for k, v in self.parameters.items()}
        self.optimizer = torch.optim.Adam(list(self.parameters.values()), lr=0.02, eps=1e-15)
        self.accumulated = torch.zeros((len(self.parameters["xyz"]), 1), device="cuda")
        self.seen = torch.zeros_like(self.accumulated)

    def densify(self) -> None:
        """Clone what moved most."""
        mean = (self.accumulated / self.seen).nan_to_num(0.0)
        rows = (mean[:, 0] >= THRESHOLD).nonzero()[:, 0]
        self.parameters = {k: torch.cat([v, v[rows]]) for k, v in self.parameters.items()}
        self.train()


def render(camera, gaussians: Gaussians, background: torch.Tensor) -> dict:
    """Render with all arguments named, as trainers of this kind do."""
    p = gaussians.parameters
    # Neither a leaf nor a part of the image: its gradient alone is of interest.
    points = 0 * p["xyz"].detach().cuda().requires_grad_(torch.is_grad_enabled())
    if points.requires_grad:
        points.retain_grad()
    tangent = math.tan(camera.field / 2)
    settings = GaussianRasterizationSettings(
        image_height=camera.size,
        image_width=camera.size,
        tanfovx=tangent,
        tanfovy=tangent,
        bg=background,
        scale_modifier=1.0,
        viewmatrix=camera.world_view_transform.cuda(),
        projmatrix=camera.full_proj_transform.cuda(),
        sh_degree=1,
        campos=camera.camera_center.cuda(),
        prefiltered=False,
        debug=False,
    )
    image, radii = GaussianRasterizer(raster_settings=settings)(
        means3D=p["xyz"],
        means2D=points,
        shs=p["features"],
        colors_precomp=None,
        opacities=torch.sigmoid(p["opacity"]),
        scales=torch.exp(p["scaling"]),
        rotations=nn.functional.normalize(p["rotation"]),
        cov3D_precomp=None,
    )
    return {"image": image, "points": points, "seen": radii > 0}


def main(steps: int) -> None:
    """Train, and print what came of it."""
    torch.manual_seed(0)
    gaussians = Gaussians(torch.rand(60, 3) * 2 - 1)
    background = torch.zeros(3, device="cuda")
    start, end = torch.cuda.Event(enable_timing=True), torch.cuda.Event(enable_timing=True)
    views = list(zip(cameras(), targets(), strict=True))
    start.record()
    for step in range(1, steps + 1):
        camera, target = views[step % len(views)]
        package = render(camera, gaussians, background)
        image, truth = package["image"], target.cuda()
        similar = fused_ssim(image[None], truth[None])
        loss = 0.8 * (image - truth).abs().mean() + 0.2 * (1 - similar)
        loss.backward()
        with torch.no_grad():
            seen, gradient = package["seen"], package["points"].grad
            moved = gradient[:, :2].square().sum(1).sqrt()
            gaussians.accumulated += (moved * seen)[:, None]
            gaussians.seen += seen[:, None]
            gaussians.optimizer.step()
            gaussians.optimizer.zero_grad(set_to_none=True)
            if step % 20 == 0:
                gaussians.densify()
                torch.cuda.empty_cache()
    end.record()
    torch.cuda.synchronize()
    with torch.no_grad():
        errors = [
            (render(camera, gaussians, background)["image"] - target).square().mean()
            for camera, target in views
        ]
    psnr = -10 * torch.stack(errors).mean().log10()
    count = len(gaussians.parameters["xyz"])
    print(f"PSNR {float(psnr):.2f} gaussians {count} timed {start.elapsed_time(end) > 0}")


if __name__ == "__main__":
    main(int(sys.argv[1]))
