"""A small trainer with the calls of those that grew from the original one, for CUDA as it says.

python -m gsfw.compat inria_like.py STEPS
"""

# ruff: noqa: T201
import contextlib
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
        distances = torch.clamp_min(distCUDA2(points.float().cuda()), 1e-7)
        count = len(points)
        self.parameters = {
            "xyz": points.float().cuda(),
            "features": torch.zeros((count, 4, 3), device="cuda"),
            "scaling": torch.log(torch.sqrt(distances))[..., None].repeat(1, 3),
            "rotation": torch.tensor([[1.0, 0, 0, 0]], device="cuda").repeat(count, 1),
            "opacity": torch.zeros((count, 1), device="cuda"),
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
    """Render as the original's gaussian_renderer does."""
    p = gaussians.parameters
    points = torch.zeros_like(p["xyz"], requires_grad=True, device="cuda") + 0
    with contextlib.suppress(RuntimeError):  # Where there are no gradients.
        points.retain_grad()
    settings = GaussianRasterizationSettings(
        image_height=camera.size,
        image_width=camera.size,
        tanfovx=math.tan(camera.field * 0.5),
        tanfovy=math.tan(camera.field * 0.5),
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
    return {"render": image, "viewspace_points": points, "seen": radii > 0, "radii": radii}


def main(steps: int) -> None:
    """Train, and print what came of it."""
    torch.manual_seed(0)
    gaussians = Gaussians(torch.rand(60, 3) * 2 - 1)
    background = torch.tensor([0.0, 0.0, 0.0], dtype=torch.float32, device="cuda")
    start, end = torch.cuda.Event(enable_timing=True), torch.cuda.Event(enable_timing=True)
    views = list(zip(cameras(), targets(), strict=True))
    start.record()
    for step in range(1, steps + 1):
        camera, target = views[step % len(views)]
        package = render(camera, gaussians, background)
        image, truth = package["render"], target.cuda()
        similar = fused_ssim(image[None], truth[None])
        loss = 0.8 * (image - truth).abs().mean() + 0.2 * (1 - similar)
        loss.backward()
        with torch.no_grad():
            seen, gradient = package["seen"], package["viewspace_points"].grad
            gaussians.accumulated[seen] += torch.norm(gradient[seen, :2], dim=-1, keepdim=True)
            gaussians.seen[seen] += 1
            gaussians.optimizer.step()
            gaussians.optimizer.zero_grad(set_to_none=True)
            if step % 20 == 0:
                gaussians.densify()
                torch.cuda.empty_cache()
    end.record()
    torch.cuda.synchronize()
    with torch.no_grad():
        errors = [
            (render(camera, gaussians, background)["render"] - target).square().mean()
            for camera, target in views
        ]
    psnr = -10 * torch.stack(errors).mean().log10()
    count = len(gaussians.parameters["xyz"])
    print(f"PSNR {float(psnr):.2f} gaussians {count} timed {start.elapsed_time(end) > 0}")


if __name__ == "__main__":
    main(int(sys.argv[1]))
