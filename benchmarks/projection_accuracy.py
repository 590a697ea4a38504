"""Errors of splatting against true rays and against a volume, and the costs of these.

    OMP_NUM_THREADS=1 python benchmarks/projection_accuracy.py [FOLDER]

writes projection-accuracy.png and splatting-and-volume.png to FOLDER (docs/images when left out)
and prints the tables of docs/results/what-accuracy-costs.md; about a minute and a half on one core.
All is in float64 but the native kernels; times are CPU time, and errors are those of the pixels
that any of the images has drawn, as PSNR of colours in [0, 1].
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from torch import Tensor

from gsfw.charts.lines import Line, LinePanel, line_figure
from gsfw.charts.style import write_figure
from gsfw.core.cameras import Cameras
from gsfw.core.errors import UserError
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_output import RenderOutput
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.cpu.config import CpuConfig
from gsfw.rasterizers.ray.peak import Peak
from gsfw.rasterizers.ray.rasterizer import RayRasterizer
from gsfw.rasterizers.ray.volume import Volume
from gsfw.rasterizers.reference.bin import PIXELS, bin_ellipses
from gsfw.rasterizers.reference.project import project, visible_extents
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

SEEDS = 8
"""Scenes whose squared errors are averaged."""
FLATNESS = (1.0, 0.5, 0.1)
"""Deviations of a Gaussian along its axes, of its scale: what training makes of surfaces."""
THICKNESS = (1.0, 0.7, 0.4)
"""The same where samples have to find them."""
COVERAGE = 40
"""Pixels of the image for each Gaussian, where all are of a size."""
ANGLES = (20, 40, 60, 80, 100, 120, 140)
DISTANCES = (2, 4, 8, 16, 32, 64, 128, 256)
PIXEL_SCALES = (0.25, 0.5, 1, 2, 4, 8)
SAMPLES = (4, 8, 16, 32, 64, 128, 256)
OPACITIES = (0.05, 0.1, 0.2, 0.4, 0.8, 0.95)
CONVERGED = 1024
"""Samples that stand for infinitely many."""
PROJECTION = "projection: splatting against peaks on rays, sorted by their means in both"
BOTH = "projection and sorting: splatting against peaks sorted along each ray"
SORTING = "sorting: peaks sorted by their means against peaks sorted along each ray"
REFERENCE = ReferenceRasterizer()
BY_MEAN = RayRasterizer(Peak("mean"))
BY_RAY = RayRasterizer(Peak("ray"))


def camera_of(width: int, height: int, focal: float) -> Cameras:
    """At the origin, along +z; ``focal`` in pixels."""
    intrinsics = torch.tensor([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return Cameras(torch.eye(4)[None].double(), intrinsics[None].double(), width, height)


def scene_of(
    camera: Cameras,
    count: int,
    distance: float,
    seed: int,
    deviations: tuple[float, float, float] = FLATNESS,
) -> Splats:
    """Gaussians at random pixels and between 1 and 3 off, which times scale is ``distance``."""
    generator = torch.Generator().manual_seed(seed)

    def uniform(*shape: int) -> Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    size = torch.tensor([camera.width, camera.height], dtype=torch.float64)
    plane = (uniform(count, 2) * size - camera.intrinsics[0, :2, 2]) / camera.intrinsics[0, 0, 0]
    directions = torch.nn.functional.normalize(
        torch.cat([plane, torch.ones(count, 1, dtype=torch.float64)], dim=1), dim=1
    )
    lengths = 1 + 2 * uniform(count)
    return Splats(
        means=directions * lengths[:, None],
        opacities=0.2 + 0.75 * uniform(count),
        colors=uniform(count, 3),
        quats=torch.randn(count, 4, generator=generator, dtype=torch.float64),
        scales=lengths[:, None] / distance * torch.tensor(deviations, dtype=torch.float64),
    )


def squared_error(first: RenderOutput, second: RenderOutput) -> tuple[float, int]:
    """Sum over what either has drawn, and how many numbers that is."""
    drawn = (first.alpha > 0) | (second.alpha > 0)
    difference = (first.color - second.color) * drawn
    return difference.square().sum().item(), 3 * int(drawn.sum())


def psnr(errors: Sequence[tuple[float, int]]) -> float:
    """PSNR of sums of squares and their counts."""
    mean = sum(error for error, _ in errors) / sum(count for _, count in errors)
    return -10 * math.log10(mean) if mean > 0 else math.inf


def ladder(camera: Cameras, count: int, distance: float) -> tuple[float, float, float]:
    """PSNR by error of projection, of projection and sorting, and of sorting."""
    found: tuple[list[tuple[float, int]], ...] = ([], [], [])
    for seed in range(SEEDS):
        splats = scene_of(camera, count, distance, seed)
        splatted, by_mean, by_ray = (
            rasterizer.render(splats, camera) for rasterizer in (REFERENCE, BY_MEAN, BY_RAY)
        )
        pairs = ((splatted, by_mean), (splatted, by_ray), (by_mean, by_ray))
        for errors, pair in zip(found, pairs, strict=True):
            errors.append(squared_error(*pair))
    projection, both, sorting = (psnr(errors) for errors in found)
    return projection, both, sorting


def over_angles() -> Iterator[tuple[float, float, float, float]]:
    """Strips of ever larger fields of view, in which Gaussians keep their size in pixels."""
    focal, height = 90.0, 48
    for angle in ANGLES:
        width = round(2 * focal * math.tan(math.radians(angle / 2)))
        yield angle, *ladder(camera_of(width, height, focal), width * height // COVERAGE, 30.0)


def over_distances() -> Iterator[tuple[float, float, float, float]]:
    """Images of the same size, of ever smaller angles: Gaussians of 4 pixels near the axis."""
    for distance in DISTANCES:
        camera = camera_of(64, 64, 4.0 * distance)
        yield distance, *ladder(camera, 64 * 64 // COVERAGE, distance)


def over_pixel_scales() -> Iterator[tuple[float, float, float, float]]:
    """One view of 60 degrees, at ever more pixels."""
    for scale in PIXEL_SCALES:
        focal = 30.0 * scale
        side = round(2 * focal * math.tan(math.radians(30)))
        yield scale, *ladder(camera_of(side, side, focal), 120, 30.0)


def projection() -> tuple[str, list[LinePanel]]:
    """The first section: its tables and panels."""
    sweeps: list[tuple[str, str, Callable[[], Iterator[tuple[float, float, float, float]]]]] = [
        ("field of view (degrees)", "over the field of view", over_angles),
        ("distance / scale", "over distance, on the axis", over_distances),
        ("scale (pixels)", "over scale, 60 degrees", over_pixel_scales),
    ]
    text, panels = "", []
    for across, title, sweep in sweeps:
        rows = list(sweep())
        text += f"| {across} | projection (dB) | projection and sorting (dB) | sorting (dB) |\n"
        text += "| ---: | ---: | ---: | ---: |\n"
        text += "".join(f"| {x:g} | {a:.1f} | {b:.1f} | {c:.1f} |\n" for x, a, b, c in rows) + "\n"
        lines = tuple(
            Line(name, tuple((row[0], row[number]) for row in rows))
            for number, name in enumerate((PROJECTION, BOTH, SORTING), start=1)
        )
        doubling = "degrees" not in across
        panels.append(LinePanel(f"PSNR (dB) {title}", across, lines, doubling=doubling))
    return text, panels


@dataclass(frozen=True)
class Measured:
    """One way to draw an image."""

    name: str
    output: RenderOutput
    seconds: float
    evaluations: int


def measured(name: str, rasterizer: Rasterizer, splats: Splats, camera: Cameras) -> Measured:
    """Draw an image; the CPU time is the least of three, or of one that takes long."""
    seconds = math.inf
    for _ in range(3):
        before = time.process_time()
        output = rasterizer.render(splats, camera)
        seconds = min(seconds, time.process_time() - before)
        if seconds > 1:
            break
    if isinstance(rasterizer, RayRasterizer):
        evaluations = rasterizer.evaluations
    else:
        evaluations = splatting_evaluations(splats, camera)
    return Measured(name, output, seconds, evaluations)


def splatting_evaluations(splats: Splats, camera: Cameras) -> int:
    """Pixels of all tiles that each splat meets."""
    settings = RenderSettings()
    ellipses = project(splats, camera, settings)
    visible, _ = visible_extents(ellipses, camera, settings)
    seen = project(splats, camera, settings, visible.nonzero()[:, 0])
    return int(bin_ellipses(seen, camera, settings.profile, 4096.0).counts.sum()) * PIXELS


def volume() -> tuple[str, list[LinePanel]]:
    """The second section: its table and panels."""
    camera = camera_of(48, 36, 42.0)
    splats = scene_of(camera, 150, 20.0, 0, THICKNESS)
    truth = RayRasterizer(Volume(CONVERGED)).render(splats, camera)
    ways: dict[str, Rasterizer] = {"splatting (reference)": REFERENCE, "peaks on rays": BY_RAY}
    ways |= {f"volume, {n} middles": RayRasterizer(Volume(n)) for n in SAMPLES}
    ways |= {f"volume, {n} random": RayRasterizer(Volume(n, 0)) for n in SAMPLES}
    found = {name: measured(name, way, splats, camera) for name, way in ways.items()}
    accuracy = {name: psnr([squared_error(one.output, truth)]) for name, one in found.items()}
    text = "| way | evaluations | per pixel | CPU (ms) | us per pixel | us per Gaussian | "
    text += "PSNR against the volume (dB) |\n| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n"
    pixels = camera.width * camera.height
    for name, one in found.items():
        text += f"| {name} | {one.evaluations:,} | {one.evaluations / pixels:,.0f} | "
        text += f"{1e3 * one.seconds:.1f} | {1e6 * one.seconds / pixels:.1f} | "
        text += f"{1e6 * one.seconds / len(splats):.0f} | {accuracy[name]:.1f} |\n"

    def lines(value: Callable[[Measured], float]) -> tuple[Line, ...]:
        flat = [
            Line(name, tuple((n, value(found[name])) for n in (SAMPLES[0], SAMPLES[-1])), True)
            for name in ("splatting (reference)", "peaks on rays")
        ]
        return *flat, *(
            Line(
                f"volume, {kind}",
                tuple((n, value(found[f"volume, {n} {kind}"])) for n in SAMPLES),
            )
            for kind in ("middles", "random")
        )

    return text, [
        LinePanel(title, "samples", lines(value), doubling=True, decades=decades)
        for title, value, decades in (
            ("PSNR (dB) against 1024 samples", lambda one: accuracy[one.name], False),
            ("CPU time (ms)", lambda one: 1e3 * one.seconds, True),
            ("evaluations (millions)", lambda one: one.evaluations / 1e6, True),
        )
    ]


def scaling() -> str:
    """Costs of four times the pixels, and of four times the Gaussians, each way."""
    ways: dict[str, Rasterizer] = {"splatting (reference)": REFERENCE}
    with suppress(UserError):  # Without the native module there is a row less.
        ways["splatting (cpu, float32)"] = CpuConfig().build(torch.device("cpu"))
    ways |= {"peaks on rays": BY_RAY, "volume, 32 middles": RayRasterizer(Volume(32))}
    sizes = {"96x72, 400": (2, 400), "192x144, 400": (4, 400), "96x72, 1600": (2, 1600)}
    text = "| way | " + " | ".join(f"{name} (ms)" for name in sizes)
    text += " | x4 pixels | x4 Gaussians |\n| --- |" + " ---: |" * (len(sizes) + 2) + "\n"
    for name, way in ways.items():
        seconds = []
        for zoom, count in sizes.values():
            camera = camera_of(48 * zoom, 36 * zoom, 42.0 * zoom)
            splats = scene_of(camera, count, 20.0, 0, THICKNESS)
            if "float32" in name:
                camera, splats = camera.to(dtype=torch.float32), splats.map(Tensor.float)
            seconds.append(measured(name, way, splats, camera).seconds)
        text += f"| {name} | " + " | ".join(f"{1e3 * one:.1f}" for one in seconds)
        text += f" | {seconds[1] / seconds[0]:.1f} | {seconds[2] / seconds[0]:.1f} |\n"
    return text


def opacities() -> str:
    """Distances of peaks from the volume, by the opacity of the Gaussians."""
    camera, ray = camera_of(48, 36, 42.0), RayRasterizer(Volume(SAMPLES[-1]))
    text = "| opacity | alpha (dB) | colours (dB) |\n| ---: | ---: | ---: |\n"
    for opacity in OPACITIES:
        splats = scene_of(camera, 150, 20.0, 0, THICKNESS)
        splats = replace(splats, opacities=torch.full_like(splats.opacities, opacity))
        peaks, volume = (way.render(splats, camera) for way in (BY_RAY, ray))
        alphas = [
            replace(output, color=output.alpha.expand(-1, -1, -1, 3)) for output in (peaks, volume)
        ]
        found = (psnr([squared_error(*alphas)]), psnr([squared_error(peaks, volume)]))
        text += f"| {opacity:g} | {found[0]:.1f} | {found[1]:.1f} |\n"
    return text


if __name__ == "__main__":
    images = Path(__file__).resolve().parents[1] / "docs" / "images"
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=images)
    folder = parser.parse_args().folder
    tables, plots = projection()
    write_figure(folder / "projection-accuracy.png", line_figure(plots))
    print(tables)  # noqa: T201 - what it is for
    tables, plots = volume()
    write_figure(folder / "splatting-and-volume.png", line_figure(plots))
    print(f"{tables}\n{scaling()}\n{opacities()}")  # noqa: T201 - what it is for
