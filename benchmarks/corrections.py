"""Exposures and refined poses on captures that are as taken, or made wrong on purpose.

    python benchmarks/corrections.py DATA [DATA ...] --faults none poses1 --seeds 1 2 3
        --rows strategy=adc refine_poses=true --settings downscale=8 steps=600

Trains every row of settings with every fault and seed on the CPU; prints a Markdown table with
held-out PSNR and colour-corrected PSNR, as mean and standard deviation over the seeds. Only
training views are made wrong, so that all rows are compared with the same images and cameras.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from statistics import mean, stdev

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import torch
from printing import say
from support.perturbed_captures import WrongCapture, wrong_motions
from torch import Tensor

from gsfw.core.datamanager import DataManager, Split
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.compose import compose
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, Settings, resolve

ALWAYS = ("method=3dgs", "device=cpu", "eval_every=0", "checkpoint_every=0")
FIGURES = ("psnr", "color_corrected_psnr")


def wrong_poses(degrees: float) -> Callable[[DataManager], DataManager]:
    """Poses turned by an angle, and moved by 2 % of the extent for each degree."""
    return lambda data: WrongCapture(data, wrong_motions(data, degrees, 0.02 * degrees))


def random(data: DataManager, *size: int) -> Tensor:
    """Numbers in [-1, 1] for each training view."""
    generator = torch.Generator().manual_seed(4)
    return 2 * torch.rand(len(data.views(Split.TRAIN).names), *size, generator=generator) - 1


def wrong_gains(data: DataManager) -> DataManager:
    """Gains of 0.7 to 1.3 for each image and channel, as of exposure and white balance."""
    gains = 1 + 0.3 * random(data, 3)
    return WrongCapture(data, tones=(gains / gains.mean(dim=0))[:, None, None, :])


def wrong_tones(data: DataManager) -> DataManager:
    """Gains within a factor of 1.5 that vary smoothly over each image, as of local tone mapping."""
    coarse = random(data, 1, 3, 3)
    logs = math.log(1.5) * (coarse - coarse.mean(dim=0))
    return WrongCapture(data, tones=logs.exp().movedim(1, -1))


def vignetting(data: DataManager) -> DataManager:
    """Corners darker by 0 to 60 %, by another part in each image."""
    across = torch.linspace(-1, 1, 9)
    squares = (across[:, None] ** 2 + across[None, :] ** 2) / 2
    strength = 0.3 * (1 + random(data, 1, 1))
    return WrongCapture(data, tones=(1 - strength * squares)[..., None])


FAULTS: dict[str, Callable[[DataManager], DataManager]] = {
    "none": lambda data: data,
    "poses0.5": wrong_poses(0.5),
    "poses1": wrong_poses(1.0),
    "gains": wrong_gains,
    "tones": wrong_tones,
    "vignetting": vignetting,
}


def settings_of(given: list[str]) -> Settings:
    """Settings of a run."""
    pairs = dict(item.split("=", 1) for item in (*ALWAYS, *given))
    return resolve(installed(), [Layer("the benchmark", pairs)])


def trained(given: list[str], fault: str) -> tuple[float, ...]:
    """The figures of a run, and its seconds of training."""
    settings = settings_of(given)
    data = FAULTS[fault](open_data(settings))
    composition = compose(settings, installed(), data=data)
    with tempfile.TemporaryDirectory() as folder:
        summary = composition.trainer(RunFolder(Path(folder))).fit()
    return (*(summary[name] for name in FIGURES), summary["train_seconds"])


def text(values: tuple[float, ...]) -> str:
    """Mean and standard deviation."""
    spread = f" ± {stdev(values):.2f}" if len(values) > 1 else ""
    return f"{mean(values):.2f}{spread}"


def main(arguments: list[str]) -> None:
    """Train all rows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("data", nargs="+", help="data sets; - is the built-in scene")
    parser.add_argument("--faults", nargs="+", default=["none"], choices=FAULTS)
    parser.add_argument("--rows", nargs="+", default=[""], help="settings of a row, in quotes")
    parser.add_argument("--seeds", nargs="+", default=["1"])
    parser.add_argument("--settings", nargs="*", default=[], help="settings of all runs")
    asked = parser.parse_args(arguments)
    say("| data | fault | settings | PSNR | colour-corrected PSNR | s |\n|---|---|---|---|---|---|")
    for data in asked.data:
        of_data = [] if data == "-" else [f"data={data}"]
        for fault in asked.faults:
            for row in asked.rows:
                given = [*of_data, *asked.settings, *row.split()]
                found = [trained([*given, f"seed={seed}"], fault) for seed in asked.seeds]
                *figures, seconds = zip(*found, strict=True)
                cells = " | ".join(text(values) for values in figures)
                name = Path(data).name if of_data else "built-in scene"
                say(f"| {name} | {fault} | {row or '-'} | {cells} | {mean(seconds):.0f} |")


if __name__ == "__main__":
    main(sys.argv[1:])
