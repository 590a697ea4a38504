"""Held-out figures of photos with things pasted into them, with and without ignore_distractors.

    python benchmarks/distractors.py [NAME=VALUE ...] [--data DIR] [--shares 0 0.3 0.6] [--seeds 3]

Prints the rows of the table in docs/results/corrections.md: the built-in scene, or a still capture.
Each training image of a share gets one to three ellipses of other colours; held-out images stay
clean.

    python benchmarks/distractors.py --finding [NAME=VALUE ...] [--data DIR] [--shares 0 0.3]

Prints the rows of the table in docs/results/findings.md: after a run that ignores no distractors,
the number of images that count for its finding, of those with distractors and of the others. Here
training images and held-out ones have distractors.
"""

# ruff: noqa: T201
from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from jaxtyping import Float, UInt8
from made_capture import MadeCapture
from PIL import Image

from gsfw.commands.interface.arguments import Arguments, layers
from gsfw.core.datamanager import Split
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.compose import Composition, compose
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import resolve

HELD_OUT = 8
"""One image of so many is held out."""
SIZES = (0.25, 0.6)
"""Axes of an ellipse, in shorter sides of the image."""


def spoiled(capture: MadeCapture, share: float, seed: int, held_out: bool = False) -> MadeCapture:
    """The capture with distractors in ``share`` of its training images, or of all images."""
    random = np.random.default_rng(seed)
    whole = [index for index in range(len(capture)) if held_out or index % HELD_OUT]
    chosen = random.permutation(whole)[: round(share * len(whole))]
    images = list(capture.images)
    for index in sorted(chosen.tolist()):
        for _ in range(random.integers(1, 4)):
            images[index] = _pasted(images[index], capture, random)
    return replace(capture, images=tuple(images))


def _pasted(
    pixels: UInt8[np.ndarray, "h w d"], capture: MadeCapture, random: np.random.Generator
) -> UInt8[np.ndarray, "h w d"]:
    """The image with one ellipse: a part of another image, or a random smooth texture."""
    height, width = pixels.shape[:2]
    tall, wide = (random.uniform(*SIZES, 2) * min(height, width)).astype(int)
    top, left = random.integers(height - tall), random.integers(width - wide)
    y, x = np.mgrid[-1 : 1 : tall * 1j, -1 : 1 : wide * 1j]
    inside = (x**2 + y**2 < 1)[..., None]
    if random.random() < 1 / 3:
        other = capture.images[random.integers(len(capture))]
        upper, first = random.integers(height - tall), random.integers(width - wide)
        colors = other[upper : upper + tall, first : first + wide, :3].astype(float)[::-1, ::-1]
    else:
        colors = _texture(tall, wide, random)
    covered = np.full((tall, wide, pixels.shape[2]), 255.0)
    covered[..., :3] = colors
    found = pixels.copy()
    part = found[top : top + tall, left : left + wide]
    part[:] = np.where(inside, covered, part).astype(np.uint8)
    return found


def _texture(tall: int, wide: int, random: np.random.Generator) -> Float[np.ndarray, "h w 3"]:
    """A random colour with smooth variations."""
    coarse = int(random.choice([3, 10]))
    values = random.uniform(0, 255, 3) + random.uniform(-60, 60, (coarse, coarse, 3))
    layers = [Image.fromarray(values[..., channel].astype(np.float32)) for channel in range(3)]
    size, bicubic = (wide, tall), Image.Resampling.BICUBIC
    return np.stack([layer.resize(size, bicubic) for layer in layers], -1).clip(0, 255)


def psnr(data: Path, out: Path, settings: list[str]) -> float:
    """Held-out PSNR of one run in dB."""
    command = (
        *(sys.executable, "-m", "gsfw", "train", "method=3dgs", f"data={data}", f"out={out}"),
        *(f"holdout_every={HELD_OUT}", "holdout_by=name", "device=cpu", "report=false"),
        *("eval_every=0", "callbacks.tensorboard.enabled=false", "json=true", *settings),
    )
    found = subprocess.run(command, check=False, capture_output=True, text=True)
    if found.returncode:
        sys.exit(found.stderr)
    return float(json.loads(found.stdout)["psnr"])


def row(capture: MadeCapture, share: float, seeds: int, settings: list[str]) -> str:
    """A row of the table: the mean PSNR without and with the setting, and each difference."""
    values = np.zeros((seeds, 2))
    for seed in range(seeds):
        with TemporaryDirectory() as folder:
            data = spoiled(capture, share, seed).write(Path(folder) / "capture")
            for place, word in enumerate(("false", "true")):
                given = [f"ignore_distractors={word}", f"seed={seed}", *settings]
                values[seed, place] = psnr(data, Path(folder) / word, given)
    off, on = values.mean(0)
    gains = " ".join(f"{gain:+.2f}" for gain in values[:, 1] - values[:, 0])
    return f"| {share:.0%} | {off:.2f} | {on:.2f} | {gains} |"


def finding_row(capture: MadeCapture, share: float, seed: int, settings: list[str]) -> str:
    """A row of the other table: contradicted images with and without distractors, after a run."""
    made = spoiled(capture, share, seed, held_out=True)
    pairs = zip(made.names, made.images, capture.images, strict=True)
    shows = {name: pixels is not clean for name, pixels, clean in pairs}
    with TemporaryDirectory() as folder:
        data = made.write(Path(folder) / "capture")
        given = ("method=3dgs", f"data={data}", "device=cpu", f"seed={seed}", *settings)
        words = tuple((key, value) for key, _, value in (word.partition("=") for word in given))
        run = compose(resolve(installed(), layers(Arguments((), words))), installed())
        run.trainer(RunFolder(Path(folder) / "run")).fit()
        found = Counter(
            (shows[Path(name).stem], is_seen) for name, is_seen in _contradicted(run).items()
        )
    cells = (f"{found[own, True]} of {found[own, True] + found[own, False]}" for own in (1, 0))
    return f"| {share:.0%} | {' | '.join(cells)} |"


@torch.no_grad()
def _contradicted(run: Composition) -> dict[str, bool]:
    """All images by name, and whether the trained model contradicts them."""
    parts, settings, found = run.parts, run.plan.settings, {}
    assert settings.background is not None
    for split in (Split.TRAIN, Split.EVAL):
        for index, name in enumerate(parts.data.views(split).names):
            (batch,) = parts.data.load(split, [index], parts.device)
            output = parts.render(batch.cameras, settings, batch.time).output
            found[name] = parts.contradicts(batch, output, settings.background, split)
    return found


def main() -> None:
    """Print the rows of one capture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", default="", help="a still capture; default: the built-in scene")
    parser.add_argument("--side", type=int, default=160, help="longer side of an image, in pixels")
    parser.add_argument("--images", type=int, default=34, help="number of images")
    parser.add_argument("--shares", type=float, nargs="+", default=[0.0, 0.3, 0.6])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--finding", action="store_true", help="print the other table")
    parser.add_argument("settings", nargs="*", default=["steps=1000"], help="of the runs")
    given = parser.parse_args()
    words = Arguments((), (("data", given.data), ("method", "3dgs")))
    data = open_data(resolve(installed(), layers(words)))
    capture = MadeCapture.of(data, given.side, given.images)
    for share in given.shares:
        if given.finding:
            for seed in range(given.seeds):
                print(finding_row(capture, share, seed, given.settings), flush=True)
        else:
            print(row(capture, share, given.seeds, given.settings), flush=True)


if __name__ == "__main__":
    main()
