"""Level of detail: what a budget costs, near and far, against the most useful Gaussians alone.

    python benchmarks/level_of_detail.py RUN [VIEWS]

RUN is a run or a splat file. Near views are its cameras, far ones the same moved back, by four
times their distance from what they look at. PSNR is against renders of the whole model. The same
number of Gaussians is drawn in each view: those of a cut, or those with the largest contributions
to the near views (``gsfw export keep=``).
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace

import torch
from torch import Tensor

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.core.cameras import Cameras
from gsfw.core.contributions import Contributions, most_useful
from gsfw.core.datamanager import Split, spread
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.maths.camera_path import gathered, viewing_center
from gsfw.core.maths.frame import with_axes
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.lod.build import build
from gsfw.lod.cut import Limits, select
from gsfw.plugins.registry import installed

PARTS = (1.0, 0.5, 0.25, 0.1, 0.05)
FAR = 5.0


def main() -> None:
    """Print a line for each budget."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run")
    parser.add_argument("views", nargs="?", type=int, default=8)
    asked = parser.parse_args()
    found = find_run(asked.run, print, splats=True)
    composition = restore_run(found, installed()).composition
    parts, settings = composition.parts, composition.plan.settings
    given = list(parts.data.views(Split.TRAIN).cameras)
    near = [given[n] for n in spread(range(len(given)), asked.views)]
    middle = viewing_center(gathered(given))
    far = [moved_back(camera, middle) for camera in near]
    with torch.no_grad():
        whole = with_axes(parts.model.splats())
        begin = time.perf_counter()
        tree = build(whole.to("cpu"))
        seconds = time.perf_counter() - begin
        scores = Contributions.of(
            parts.model.splats, len(whole), near, parts.rasterizer, settings
        ).total
        print(f"{len(whole):,} Gaussians, tree in {seconds:.2f} s")
        for name, cameras in (("near", near), ("far", far)):
            targets = [draw(parts, whole, camera, settings) for camera in cameras]
            for part in PARTS:
                most = max(int(part * len(whole)), 1)
                cuts, times, sizes = [], [], []
                for camera in cameras:
                    begin = time.perf_counter()
                    numbers = select(tree, camera, Limits(most))
                    times.append(time.perf_counter() - begin)
                    sizes.append(len(numbers))
                    cuts.append(draw(parts, tree.nodes(numbers).splats(), camera, settings))
                fewer = whole.take(most_useful(scores, most))
                kept = [draw(parts, fewer, camera, settings) for camera in cameras]
                row = {
                    "views": name,
                    "budget": part,
                    "gaussians": most,
                    "drawn": sum(sizes) // len(sizes),
                    "cut_psnr": psnr(cuts, targets),
                    "most_useful_psnr": psnr(kept, targets),
                    "cut_ms": 1000 * sorted(times)[len(times) // 2],
                }
                print(json.dumps({key: rounded(value) for key, value in row.items()}), flush=True)


def moved_back(camera: Cameras, middle: Tensor) -> Cameras:
    """The camera, ``FAR`` times as far from the middle of the scene, along its axis."""
    pose = camera.world_to_camera.clone()
    depth = float(pose[0, 2, :3] @ middle.to(pose) + pose[0, 2, 3])
    pose[:, 2, 3] += (FAR - 1) * abs(depth)
    return replace(camera, world_to_camera=pose)


def draw(parts: TrainingParts, splats: Splats, camera: Cameras, settings: RenderSettings) -> Tensor:
    """The image of some splats."""
    device = parts.device
    return parts.rasterizer.render(splats.to(device), camera.to(device), settings).color[0].cpu()


def psnr(images: list[Tensor], targets: list[Tensor]) -> float:
    """The mean PSNR of the images, in dB; 100 for equal ones."""
    errors = [
        (image.clamp(0, 1) - target.clamp(0, 1)).double().square().mean()
        for image, target in zip(images, targets, strict=True)
    ]
    values = [-10 * float(error.clamp_min(1e-10).log10()) for error in errors]
    return sum(values) / len(values)


def rounded(value: object) -> object:
    """Numbers with two decimals."""
    return round(value, 2) if isinstance(value, float) else value


if __name__ == "__main__":
    main()
