"""The table of the README: training at one scale, evaluation at all others (Yu et al. 2024, 5.1).

python measure.py path/to/nerf_synthetic/chair [steps]
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

from gsfw.api import Split, open_run, psnr

WIDTHS = {"4x": 400, "2x": 200, "1x": 100, "1/2": 50, "1/4": 25}
"""Widths of the images; training is at 1x."""
TRAIN_VIEWS, EVAL_VIEWS = 50, 10
ENTRANTS = {
    "3dgs": ("method=3dgs",),
    "3dgs antialias=true": ("method=3dgs", "antialias=true"),
    "mip-splatting": ("method=mip-splatting",),
}


def shrunk_copy(source, target, width):
    """A Blender-format copy of some views at one width, shrunk by area with premultiplied alpha."""
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
                small = image.convert("RGBa").resize((width, width), Image.Resampling.BOX)
                small.convert("RGBA").save(target / file)
    return target


def train(settings, data, run, steps):
    command = (
        *(sys.executable, "-m", "gsfw", "train", *settings, f"data={data}", f"out={run}"),
        *(f"steps={steps}", "background=white", "report=false", "device=cpu", "eval_every=0"),
    )
    found = subprocess.run(command, check=False, capture_output=True, text=True)
    if found.returncode:
        sys.exit(found.stderr)


def mean_psnr(run, data):
    """Mean PSNR over the held-out views of other data."""
    opened, found = open_run(run, data=str(data)), []
    for view in range(len(opened.data.views(Split.EVAL))):
        (batch,) = opened.data.load(Split.EVAL, [view], opened.device)
        target = batch.target(opened.render_settings.background)
        found.append(psnr(opened.render(batch.cameras).color[0], target[0]))
    return sum(found) / len(found)


def main(source, steps):
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        data = {w: shrunk_copy(source, root / f"chair_{w}", w) for w in WIDTHS.values()}
        print("| method |", " | ".join(WIDTHS), "|")
        for name, settings in ENTRANTS.items():
            train(settings, data[WIDTHS["1x"]], root / name, steps)
            found = [f"{mean_psnr(root / name, data[width]):.2f}" for width in WIDTHS.values()]
            print(f"| {name} |", " | ".join(found), "|", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1500)
