"""Quality of the affine projection on the held-out views of a finished run.

    OMP_NUM_THREADS=1 python benchmarks/projection_of_run.py RUN [VIEWS]

draws up to VIEWS of them (2 when left out) by splatting and by peaks on rays, in the run's own
precision, and prints a table: PSNR against splatting, PSNR against the photo, and CPU time.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import torch

from gsfw.core.datamanager import Split
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.metrics import psnr
from gsfw.core.render_settings import RenderSettings
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore
from gsfw.rasterizers.ray.peak import Peak
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

WAYS = {
    "splatting (reference)": ReferenceRasterizer(),
    "peaks, sorted by their means": RayRasterizer(Peak("mean")),
    "peaks, sorted along each ray": RayRasterizer(Peak("ray")),
}


def projection_of_run(run: Path, count: int) -> str:
    """The table."""
    composition = restore(RunFolder(run), installed()).composition
    parts, background = composition.parts, composition.plan.settings.background
    assert background is not None
    views = range(min(count, len(parts.data.views(Split.EVAL))))
    sums = {name: [0.0, 0.0, 0.0] for name in WAYS}
    for index in views:
        (batch,) = parts.data.load(Split.EVAL, [index], torch.device("cpu"))
        splatted = None
        for name, way in WAYS.items():
            before = time.process_time()
            settings = RenderSettings(background=background)
            image = render_model(parts.model, way, batch.cameras, settings, batch.time).color[0]
            sums[name][2] += time.process_time() - before
            splatted = image if splatted is None else splatted
            if splatted is not image:
                sums[name][0] += psnr(image, splatted)
            sums[name][1] += psnr(image, batch.target(background)[0])
    text = "| way | PSNR against splatting (dB) | against the photo (dB) | CPU (s) per view |\n"
    text += "| --- | ---: | ---: | ---: |\n"
    for name, figures in sums.items():
        apart, photo, seconds = (figure / len(views) for figure in figures)
        text += f"| {name} | {f'{apart:.1f}' if apart else '-'} | {photo:.2f} | {seconds:.2f} |\n"
    return text


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("views", nargs="?", type=int, default=2)
    given = parser.parse_args()
    print(projection_of_run(given.run, given.views))  # noqa: T201
