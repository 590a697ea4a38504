"""The table of the README: photos of which each has its own exposure, tint and light.

python measure.py path/to/nerf_synthetic/chair [steps]
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

WIDTH, TRAIN_VIEWS, EVAL_VIEWS = 64, 40, 8
RUNS = {
    "3dgs": ("method=3dgs",),
    "3dgs exposure=true": ("method=3dgs", "exposure=true"),
    "3dgs-appearance": ("method=3dgs-appearance",),
}


def copy(source, target, changes):
    """A small copy, whose training images are changed by the functions of ``changes``."""
    random = np.random.default_rng(0)
    for split, most in (("train", TRAIN_VIEWS), ("test", EVAL_VIEWS)):
        name = f"transforms_{split}.json"
        document = json.loads((source / name).read_text())
        frames = document["frames"]
        document["frames"] = frames[:: max(1, len(frames) // most)][:most]
        document.pop("w", None)
        document.pop("h", None)
        (target / split).mkdir(parents=True)
        (target / name).write_text(json.dumps(document))
        for frame in document["frames"]:
            file = frame["file_path"].removeprefix("./") + ".png"
            with Image.open(source / file) as image:
                small = image.convert("RGBa").resize((WIDTH, WIDTH), Image.Resampling.BOX)
                pixels = np.asarray(small.convert("RGBA"), np.float64) / 255
            if split == "train":
                colors = pixels[..., :3]
                for change in changes:
                    colors = change(colors, random)
                pixels = np.concatenate([colors.clip(0, 1), pixels[..., 3:]], -1)
            Image.fromarray((255 * pixels + 0.5).astype(np.uint8)).save(target / file)
    return target


def exposure(colors, random):
    """Gains of each channel within half and one and a half, as of exposure and white balance."""
    return colors * random.uniform(0.6, 1.4) * random.uniform(0.85, 1.15, 3)


def light(colors, random):
    """A gradient across the image, as of light from one side, and another gamma."""
    height, width = colors.shape[:2]
    angle, strength = random.uniform(0, 2 * np.pi), random.uniform(0, 0.5)
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    slope = 1 + strength * (np.cos(angle) * x + np.sin(angle) * y)
    return (colors.clip(0, 1) ** random.uniform(0.8, 1.25)) * slope[..., None]


def main(source, steps):
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        data = copy(source, root / "changed", [light, exposure])
        for name, settings in RUNS.items():
            command = (
                *(sys.executable, "-m", "gsfw", "train", *settings, f"data={data}"),
                *(f"steps={steps}", "device=cpu", "report=false", "eval_every=0"),
                *(f"out={root / name}", "json=true", "background=white"),
            )
            found = subprocess.run(command, check=False, capture_output=True, text=True)
            if found.returncode:
                sys.exit(found.stderr)
            figures = json.loads(found.stdout)
            print(f"| {name} | {figures['psnr']:.2f} | {figures['ssim']:.4f} |", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 800)
