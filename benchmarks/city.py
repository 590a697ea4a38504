"""A generated city: whole under a limit of memory, in blocks under the same, and their seams.

    python benchmarks/city.py FOLDER [tiles=2x2] [views=24] [width=96] [height=72] [points=2000]
        [steps=300] [blocks=2x2] [limit_mb=1700] [limit=auto] [whole_steps=300] [rest=true]
        [coarse=100] [margin=0.15] [cache_mb=20] [budget=0.1]

writes FOLDER/data, trains it in one piece under the limit (which is to end), cuts and trains it in
blocks under the same limit, measures the merged model at pixels near borders of cells and
elsewhere, and draws it within a budget of Gaussians (a part of all). whole_steps=N also trains in
one piece without a limit, as a yardstick; 0: not. Results go to FOLDER/result.json. What is there
already is kept. limit=address limits the address space of each process, and not the memory of all
together (memory_limit.py).
"""

from __future__ import annotations

import argparse
import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch
from generated_city import City, city_scene, write_city
from jaxtyping import Bool, Float64
from memory_limit import MemoryLimit, memory_limit
from printing import say

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Split
from gsfw.core.loop.evaluation import render_model
from gsfw.core.one_thread import one_thread
from gsfw.datamanagers.synthetic.raycast import rays
from gsfw.partition.document import Partition, read_partition
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import Restored

DEFAULTS = {
    **{"tiles": "2x2", "views": "24", "width": "96", "height": "72", "points": "2000"},
    **{"steps": "300", "blocks": "2x2", "limit_mb": "1700", "limit": "auto", "coarse": "100"},
    **{"whole_steps": "300", "rest": "true", "margin": "0.15", "cache_mb": "20", "budget": "0.1"},
}
NEAR = 0.3
"""Distance from a border within which a pixel is near it, in world units; tiles are 3.4 wide."""
ALLOWED = 0.2
"""Decibels by which seams may be worse than the rest."""
KEPT = (
    *("error", "advice", "peak_memory_mb", "num_gaussians", "gaussians", "psnr", "render_ms"),
    *("whole", "too_large"),
)
"""Keys of what a command says that go to the results."""


def gsfw(arguments: list[str], limit: MemoryLimit | None = None) -> dict[str, object]:
    """Run a command line of gsfw; its end: the exit code, the seconds, and what it says."""
    command = [sys.executable, "-m", "gsfw", *arguments, "json=true"]
    start = time.monotonic()
    done = subprocess.run(
        command, preexec_fn=limit and limit.enter, capture_output=True, text=True, check=False
    )
    seconds = round(time.monotonic() - start, 1)
    try:
        document = json.loads(done.stdout)
    except ValueError:
        document = {"error": done.stderr.strip()[-400:]}
    if done.returncode < 0:
        document = {"error": f"ended by {signal.Signals(-done.returncode).name}"}
    kept = {key: document[key] for key in KEPT if key in document}
    return {"code": done.returncode, "seconds": seconds} | kept


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
        with one_thread():
            masks = border_pixels(city, _at(camera, pose), partition)
        for place, mask in enumerate(masks):
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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("settings", nargs="*", metavar="KEY=VALUE")
    asked = parser.parse_args(arguments)
    settings = dict(item.partition("=")[::2] for item in asked.settings)
    if unknown := settings.keys() - DEFAULTS.keys():
        parser.error(f"unknown setting {min(unknown)!r}. Settings: {', '.join(DEFAULTS)}.")
    folder, given = asked.folder, DEFAULTS | settings
    first, second = map(int, given["tiles"].split("x"))
    numbers = {name: int(given[name]) for name in ("views", "width", "height", "points")}
    city = City(tiles=(first, second), **numbers)
    if not (folder / "data" / "transforms.json").exists():
        write_city(city, folder / "data", _progress)
    result: dict[str, object] = {"city": asdict(city), "settings": given}
    with memory_limit(int(given["limit_mb"]), given["limit"]) as limit:
        result["limit"] = f"{given['limit_mb']} MB ({limit.name})"
        say(f"limit: {result['limit']}")
        trained = _under_the_limit(folder, given, limit, result)
    if trained:
        _measure(folder, given, city, result)
    (folder / "result.json").write_text(json.dumps(result, indent=1) + "\n")
    return 0 if trained else 1


def _under_the_limit(
    folder: Path, given: Mapping[str, str], limit: MemoryLimit, result: dict[str, object]
) -> bool:
    """Train in one piece and in blocks; true if the blocks are trained and merged."""
    data, cut = folder / "data", folder / "cut"
    length = _length(given, given["steps"])
    piece = ["train", "method=3dgs", f"data={data}", *length, f"out={folder / 'limited'}"]
    result["whole_under_limit"] = gsfw(piece, limit)
    say(f"in one piece under the limit: {result['whole_under_limit']}")
    if not (cut / "partition.json").exists():
        words = [f"out={cut}", f"blocks={given['blocks']}", f"margin={given['margin']}"]
        words = ["partition", str(data), *words, f"memory={given['limit_mb']}MB"]
        result["partition"] = gsfw(words, limit)
        say(f"cut: {result['partition']}")
    coarse = [f"coarse.steps={given['coarse']}", f"coarse.rest={given['rest']}"]
    points = int(given["points"]) * math.prod(map(int, given["tiles"].split("x")))
    coarse += [f"coarse.points={max(1000, points // 8)}"]
    done = gsfw(["blocks", str(cut), *length, *coarse], limit)
    result["blocks_under_limit"] = done
    say(f"in blocks under the limit: {done}")
    return done["code"] == 0


def _length(given: Mapping[str, str], steps: str) -> list[str]:
    """Settings of every training."""
    return [f"steps={steps}", "strategy=none", "report=false", f"cache_mb={given['cache_mb']}"]


def _measure(folder: Path, given: Mapping[str, str], city: City, result: dict[str, object]) -> None:
    """Measure the blocks, the merged model, its seams, and what a budget costs."""
    cut = folder / "cut"
    merged = str(cut / "merged.gsfw")
    partition = read_partition(cut)
    result["blocks"] = {
        block.name: _of_run(cut / "blocks" / block.name) | {"views": len(block.train)}
        for block in partition.blocks
    }
    say(f"blocks: {result['blocks']}")
    found = quality(opened(Path(merged), cut), city, partition)
    result["merged"] = found
    say(f"merged: {found}")
    lost = _seam_loss(found)
    result["seam_loss_db"] = lost
    verdict = "holds" if lost <= ALLOWED or math.isnan(lost) else "FAILS"
    say(f"seams lose {lost:.2f} dB; at most {ALLOWED} dB {verdict}")
    result["eval"] = gsfw(["eval", merged, f"data={cut}"])
    say(f"all Gaussians: {result['eval']}")
    rows = result["blocks_under_limit"]["gaussians"]
    budget = max(1, round(float(given["budget"]) * rows))
    result["eval_budget"] = {"budget": budget} | gsfw(
        ["eval", merged, f"data={cut}", f"budget={budget}"]
    )
    say(f"within a budget: {result['eval_budget']}")
    if int(given["whole_steps"]):
        whole = folder / "whole"
        if not (whole / "metrics.json").exists():
            length = _length(given, given["whole_steps"])
            gsfw(["train", "method=3dgs", f"data={cut}", *length, f"out={whole}"])
        result["whole"] = _of_run(whole) | quality(opened(whole, cut), city, partition)
        say(f"in one piece without a limit: {result['whole']}")
        say(f"its seams lose {_seam_loss(result['whole']):.2f} dB")


def _seam_loss(figures: Mapping[str, float]) -> float:
    return figures["inside"] - figures["seam"]


def _of_run(folder: Path) -> dict[str, object]:
    """Figures of a finished run."""
    metrics = json.loads((folder / "metrics.json").read_text())
    keys = ("train_seconds", "peak_memory_mb", "num_gaussians", "psnr")
    return {key: metrics[key] for key in keys if key in metrics}


def _progress(done: int, total: int) -> None:
    if done % 50 == 0 or done == total:
        say(f"{done} of {total} images")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
