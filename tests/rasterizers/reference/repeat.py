"""Draws the same image twice with two threads and prints the names of what differs in any bit.

A process of its own, because threads that spin while they wait make this very slow on a busy
machine, and how they wait is settled when torch is loaded. Argument: 1 for deterministic
algorithms, else 0.
"""

import os
import sys

os.environ["OMP_WAIT_POLICY"] = "passive"

from dataclasses import replace

import torch
from support.scenes import front_camera, random_splats

from gsfw.core.render_settings import Depth, RenderSettings, Statistic
from gsfw.core.splats import Sh, Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer


def everything(splats: Splats) -> dict[str, torch.Tensor | None]:
    """All values and gradients of one image."""
    inputs = {name: t.clone().requires_grad_() for name, t in splats.tensors().items()}
    camera = front_camera(16, 12, distance=2.0)
    view = camera.world_to_camera.requires_grad_()
    scene = replace(splats, **(inputs | {"colors": Sh(inputs["colors"], 1)}))
    settings = RenderSettings(depth=Depth.EXPECTED, statistics=frozenset(Statistic))
    output = ReferenceRasterizer().render(scene, camera, settings)
    (output.color.square().sum() + output.alpha.sum()).backward()
    named = {name: tensor.grad for name, tensor in inputs.items()}
    return named | {
        "view": view.grad,
        "color": output.color,
        "depth": output.depth,
        "screen gradient": output.statistics.screen_gradient,
        "absgrad": output.statistics.absgrad,
        "contribution": output.statistics.contribution,
    }


def main() -> None:
    """Draw twice, compare."""
    torch.set_num_threads(2)
    torch.set_deterministic_debug_mode("error" if sys.argv[1] == "1" else "default")
    splats = random_splats(60_000, 1)
    assert splats.scales is not None
    splats = replace(splats, scales=0.5 * splats.scales, opacities=0.1 * splats.opacities)
    first, second = everything(splats), everything(splats)
    for name, tensor in first.items():
        other = second[name]
        if tensor is None or other is None or not torch.equal(tensor, other):
            print(name)  # noqa: T201
    print(len(first), "compared")  # noqa: T201


if __name__ == "__main__":
    main()
