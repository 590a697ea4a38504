"""A generated city: whole under a limit of memory, in blocks under the same, and their seams.

    python benchmarks/city.py FOLDER [tiles=2x2] [views=24] [width=96] [height=72] [points=2000]
        [steps=300] [blocks=2x2] [limit_mb=1700] [whole=true] [rest=true] [coarse=100]

writes FOLDER/data, trains it in one piece under the limit (which is to end with a sentence), cuts
and trains it in blocks under the same limit, and measures the merged model at pixels near borders
of cells and elsewhere. whole=true also trains in one piece without a limit, as a yardstick. Results
go to FOLDER/result.json. What is there already is kept.

The limit is memory.max of a control group (cgroup v2) where one can be made; else RLIMIT_AS, the
address space of each process, which counts what is only reserved too: torch alone takes more than
1 GB of it.
"""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from generated_city import City, city_scene, write_city
from jaxtyping import Bool, Float64

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Split
from gsfw.core.loop.evaluation import render_model
from gsfw.datamanagers.synthetic.raycast import rays
from gsfw.partition.document import Partition, read_partition
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import Restored

DEFAULTS = {
    **{"tiles": "2x2", "views": "24", "width": "96", "height": "72", "points": "2000"},
    **{"steps": "300", "blocks": "2x2", "limit_mb": "1700", "whole": "true", "rest": "true"},
    **{"coarse": "100", "margin": "0.15"},
}
NEAR = 0.3
"""Distance from a border within which a pixel is near it, in world units; tiles are 3.4 wide."""
ALLOWED = 0.2
"""Decibels by which seams may be worse than the rest, compared with training in one piece."""
GROUPS = Path("/sys/fs/cgroup")


def say(*words: object) -> None:
    """Print a line at once."""
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


@contextmanager
def limited(megabytes: int) -> Iterator[tuple[str, object]]:
    """A limit of memory: its name, and what a child process calls before it starts."""
    group = GROUPS / f"gsfw-city-{os.getpid()}"
    controllers = GROUPS / "cgroup.controllers"
    try:
        if "memory" not in controllers.read_text():  # A plain folder limits nothing.
            raise OSError("no controller of memory")
        group.mkdir()
        (group / "memory.max").write_text(str(megabytes * 10**6))
    except OSError:
        if group.exists():
            group.rmdir()
        size = (megabytes * 10**6, megabytes * 10**6)
        yield "RLIMIT_AS", lambda: resource.setrlimit(resource.RLIMIT_AS, size)
        return
    try:
        yield (
            "cgroup memory.max",
            lambda: (group / "cgroup.procs").write_text(str(os.getpid())),
        )
    finally:
        group.rmdir()


def gsfw(arguments: list[str], before: object = None) -> subprocess.CompletedProcess[str]:
    """Run a command line of gsfw."""
    command = [sys.executable, "-m", "gsfw", *arguments, "json=true"]
    return subprocess.run(command, preexec_fn=before, capture_output=True, text=True, check=False)


def border_pixels(
    city: City, camera: Cameras, partition: Partition
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """The pixels near a border of cells, and those elsewhere; none of what lies outside the city.

    Args:
        city: that was photographed.
        camera: in the world of the city, without its origin.
        partition: of its data set.
    """
    height, width = camera.height, camera.width
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    origin, directions = rays(camera, torch.stack([x, y]).flatten(1).double())
    hits = city_scene(city, camera).trace(origin, directions)
    world = hits.points.T.numpy() + np.array(city.origin)
    places = partition.ground.places(world)
    distances = np.full(len(places), np.inf)
    for block in partition.blocks:
        cell = block.cell
        inside = np.maximum(np.array(cell.low) - places, places - np.array(cell.high)).max(1)
        distances = np.minimum(distances, np.where(np.isfinite(inside), np.abs(inside), np.inf))
    extent = np.abs(hits.points.T.numpy()[:, :2]).max(1)
    in_city = (hits.solid >= 0).numpy() & (extent < 1.7 * max(city.tiles))
    near = in_city & (distances < NEAR)
    return near.reshape(height, width), (in_city & ~near).reshape(height, width)


def quality(restored: Restored, city: City, partition: Partition) -> dict[str, float]:
    """PSNR of all held-out pixels near borders, and of those elsewhere."""
    parts, plan = restored.composition.parts, restored.composition.plan
    views = parts.data.views(Split.EVAL)
    world = restored.composition.scene.world_from_scene
    sums, counts = np.zeros(2), np.zeros(2)
    for index, camera in enumerate(views.cameras):
        (batch,) = parts.data.load(Split.EVAL, [index], parts.device)
        with torch.no_grad():
            shown = render_model(parts.model, parts.rasterizer, batch.cameras, plan.settings)
        error = (shown.color[0].clamp(0, 1) - batch.images[0]).square().mean(-1).numpy()
        pose = world.camera(camera.world_to_camera.double())
        shift = torch.tensor(city.origin, dtype=torch.float64)
        pose[0, :3, 3] += pose[0, :3, :3] @ shift
        for place, mask in enumerate(border_pixels(city, _at(camera, pose), partition)):
            sums[place] += error[mask].sum()
            counts[place] += mask.sum()
    near, inside = (-10 * np.log10(sums / np.maximum(counts, 1))).tolist()
    return {"seam": near, "inside": inside, "seam_pixels": int(counts[0])}


def _at(camera: Cameras, pose: Float64[torch.Tensor, "1 4 4"]) -> Cameras:
    return replace(camera.to(dtype=torch.float64), world_to_camera=pose)


def opened(path: Path, data: Path) -> Restored:
    """A run or a model file, with the images of the whole data set."""
    from gsfw.commands.interface.runs import find_run, restore_run
    from gsfw.plugins.settings import COMMAND_LINE, Layer

    found = find_run(str(path), lambda text: None)
    return restore_run(found, installed(), Layer(COMMAND_LINE, {"data": str(data)}))


def main(arguments: list[str]) -> int:
    """Generate, train in both ways, and measure."""
    folder = Path(arguments[0])
    given = DEFAULTS | dict(item.split("=", 1) for item in arguments[1:])
    first, second = map(int, given["tiles"].split("x"))
    numbers = {name: int(given[name]) for name in ("views", "width", "height", "points")}
    city = City(tiles=(first, second), **numbers)
    data, cut = folder / "data", folder / "cut"
    if not (data / "transforms.json").exists():
        write_city(city, data, _progress)
    result: dict[str, object] = {"city": asdict(city), "settings": given}
    length = [f"steps={given['steps']}", "strategy=none", "report=false"]
    with limited(int(given["limit_mb"])) as (name, before):
        result["limit"] = f"{given['limit_mb']} MB ({name})"
        done = gsfw(
            ["train", "method=3dgs", f"data={data}", *length, f"out={folder / 'limited'}"], before
        )
        result["whole_under_limit"] = _said(done)
        say("in one piece under the limit:", result["whole_under_limit"])
        if not (cut / "partition.json").exists():
            done = gsfw(
                [
                    *("partition", str(data), f"out={cut}", f"blocks={given['blocks']}"),
                    *(f"memory={given['limit_mb']}MB", f"margin={given['margin']}"),
                ],
                before,
            )
            result["partition"] = _said(done)
        coarse = [f"coarse.steps={given['coarse']}", f"coarse.rest={given['rest']}"]
        coarse += [f"coarse.points={max(1000, city.points * first * second // 8)}"]
        done = gsfw(["blocks", str(cut), *length, *coarse], before)
        result["blocks_under_limit"] = _said(done)
        say("in blocks under the limit:", result["blocks_under_limit"])
        if done.returncode:
            return done.returncode
    partition = read_partition(cut)
    result["merged"] = quality(opened(cut / "merged.gsfw", cut), city, partition)
    say("merged:", result["merged"])
    if given["whole"] == "true":
        whole = folder / "whole"
        if not (whole / "metrics.json").exists():
            gsfw(["train", "method=3dgs", f"data={cut}", *length, f"out={whole}"])
        result["whole"] = quality(opened(whole, cut), city, partition)
        say("in one piece without a limit:", result["whole"])
    _judge(result)
    (folder / "result.json").write_text(json.dumps(result, indent=1) + "\n")
    return 0


def _judge(result: dict[str, object]) -> None:
    """Print by how much the seams are worse than the rest."""
    merged = _drop(result["merged"])
    usual = _drop(result["whole"]) if "whole" in result else 0.0
    result["seam_loss_db"] = merged - usual
    verdict = "holds" if merged - usual <= ALLOWED or math.isnan(merged) else "FAILS"
    say(f"seams lose {merged - usual:.2f} dB; at most {ALLOWED} dB {verdict}")


def _drop(figures: object) -> float:
    assert isinstance(figures, Mapping)
    return figures["inside"] - figures["seam"]


def _said(done: subprocess.CompletedProcess[str]) -> dict[str, object]:
    """The end of a command: its exit code, and what it says."""
    try:
        document = json.loads(done.stdout)
    except ValueError:
        document = {"error": done.stderr.strip()[-400:]}
    kept = ("error", "advice", "peak_memory_mb", "gaussians", "psnr", "whole", "too_large")
    return {"code": done.returncode} | {key: document[key] for key in kept if key in document}


def _progress(done: int, total: int) -> None:
    if done % 50 == 0 or done == total:
        say(f"{done} of {total} images")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
