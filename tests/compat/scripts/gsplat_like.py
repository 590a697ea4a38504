"""A small trainer with the calls of gsplat's examples, and densification as its strategy reads it.

python -m gsfw.compat gsplat_like.py STEPS [packed] [absgrad]
"""

# ruff: noqa: T201
import math
import sys

import torch
from gsplat import rasterization
from targets import FIELD, SIZE, cameras, targets
from torch import nn

THRESHOLD = {False: 2e-4, True: 8e-4}


def gradients(info: dict, absgrad: bool, packed: bool, count: int) -> tuple:
    """Sums of gradient norms and numbers of views, for each Gaussian."""
    tensor = info["means2d"]
    grads = (tensor.absgrad if absgrad else tensor.grad).clone()
    grads[..., 0] *= info["width"] / 2.0 * info["n_cameras"]
    grads[..., 1] *= info["height"] / 2.0 * info["n_cameras"]
    if packed:
        rows = info["gaussian_ids"]
    else:
        seen = (info["radii"] > 0.0).all(dim=-1)
        rows, grads = torch.where(seen)[1], grads[seen]
    sums, views = torch.zeros(count, device="cuda"), torch.zeros(count, device="cuda")
    sums.index_add_(0, rows, grads.norm(dim=-1))
    views.index_add_(0, rows, torch.ones_like(rows, dtype=torch.float32))
    return sums, views


def main(steps: int, packed: bool, absgrad: bool) -> None:
    """Train, and print what came of it."""
    torch.manual_seed(0)
    device, count = torch.device("cuda:0"), 60
    params = {
        "means": torch.rand(count, 3, device=device) * 2 - 1,
        "scales": torch.full((count, 3), -1.5, device=device),
        "quats": torch.rand(count, 4, device=device),
        "opacities": torch.zeros(count, device=device),
        "colors": torch.zeros(count, 4, 3, device=device),
    }
    focal = SIZE / (2 * math.tan(0.5 * FIELD))
    matrix = torch.tensor([[focal, 0, SIZE / 2], [0, focal, SIZE / 2], [0, 0, 1]], device=device)
    views = torch.stack([camera.world_view_transform.T for camera in cameras()]).to(device)
    truth = torch.stack(targets()).permute(0, 2, 3, 1).to(device)

    def render(rows: slice) -> tuple:
        return rasterization(
            params["means"],
            params["quats"],
            torch.exp(params["scales"]),
            torch.sigmoid(params["opacities"]),
            params["colors"],
            views[rows],
            matrix[None].expand(len(views[rows]), 3, 3),
            SIZE,
            SIZE,
            sh_degree=1,
            packed=packed,
            absgrad=absgrad,
            render_mode="RGB+ED",
        )

    for step in range(1, steps + 1):
        if step % 20 == 1:
            params = {k: nn.Parameter(v.detach()) for k, v in params.items()}
            optimizers = {k: torch.optim.Adam([v], lr=0.02) for k, v in params.items()}
            sums, seen = (torch.zeros(len(params["means"]), device=device) for _ in range(2))
        rows = slice(0, 2) if step % 2 else slice(2, 4)
        images, _, info = render(rows)
        info["means2d"].retain_grad()
        loss = (images[..., :3] - truth[rows]).abs().mean()
        loss.backward()
        more, views_of = gradients(info, absgrad, packed, len(sums))
        sums, seen = sums + more, seen + views_of
        for optimizer in optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        if step % 20 == 0:
            high = (sums / seen.clamp_min(1) > THRESHOLD[absgrad]).nonzero()[:, 0]
            params = {k: torch.cat([v.detach(), v.detach()[high]]) for k, v in params.items()}
            torch.cuda.empty_cache()
    with torch.no_grad():
        images, alphas, _ = render(slice(0, 4))
    psnr = -10 * (images[..., :3] - truth).square().mean().log10()
    solid = images[..., 3:][alphas > 0.5]
    print(
        f"PSNR {float(psnr):.2f} gaussians {len(params['means'])} depth {float(solid.mean()):.2f}"
    )


if __name__ == "__main__":
    main(int(sys.argv[1]), "packed" in sys.argv, "absgrad" in sys.argv)
