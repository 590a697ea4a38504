"""The pictures of docs/start/first-ten-minutes.md and of how a model grows.

    OMP_NUM_THREADS=2 python benchmarks/first_minutes_pictures.py [FOLDER] [RUN]

trains the built-in scene twice (half a minute each on two cores; RUN is kept where it is given, and
used where it is there), and writes first-photos.jpg, first-growth.jpg and, where Chromium is
installed, first-report.jpg to FOLDER (docs/images when left out).
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import torch
from PIL import Image, ImageDraw, ImageFont
from printing import say_size
from torch import Tensor

from gsfw.commands.main import main as gsfw
from gsfw.core.callback import Callback, Control, RunInfo
from gsfw.core.cameras import Cameras
from gsfw.core.color_bytes import color_bytes
from gsfw.core.datamanager import Split
from gsfw.core.loop.model_handle import ModelHandle
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve

STEPS = (0, 30, 100, 300, 1000)
"""Finished steps at which the model is shown."""
PHOTOS = (0, 9, 20, 47)
"""Training photos that are shown."""
VIEW = 2
"""The held-out view that the model is shown from."""
WIDTH, HEIGHT = 240, 180
"""Size of a panel, in pixels."""
SMALL = 0.3
"""Size of the Gaussians in the lower row, so that they can be told apart."""
WINDOW = "1100,1500"
"""Size of the browser that shows the report."""
MOST_BYTES = 150_000


class Album(Callback):
    """Renders one view at given steps, as it is and with small Gaussians."""

    def __init__(self, camera: Cameras) -> None:
        self.camera = camera
        self.panels: list[tuple[str, Image.Image, Image.Image]] = []
        self.model: ModelHandle | None = None

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Show the model before its first step."""
        self.model = run.model
        self.on_tick(0, control)

    def on_tick(self, step: int, control: Control) -> None:
        """Show the model after some of its steps."""
        if step in STEPS and self.model is not None:
            splats = self.model.splats()
            small = replace(
                splats,
                scales=None if splats.scales is None else SMALL * splats.scales,
                opacities=splats.opacities.clamp(min=0.5) * (splats.opacities > 0.01),
            )
            drawn = self.model.rasterizer.render(small, self.camera, self.model.settings)
            shown = self.model.render(self.camera)
            caption = f"step {step:,}: {len(splats):,} Gaussians"
            self.panels.append((caption, picture(shown.color[0]), picture(drawn.color[0])))


def picture(color: Tensor) -> Image.Image:
    """A rendered image as a panel."""
    pixels = color_bytes(color.detach()).cpu().numpy()
    return Image.fromarray(pixels).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)


def growth(file: Path) -> Path:
    """The model over the steps: rendered above, its Gaussians below."""
    registry = installed()
    run = compose(resolve(registry, [Layer("the script", {"method": "3dgs"})]), registry)
    album = Album(run.parts.data.views(Split.EVAL).cameras[VIEW])
    with tempfile.TemporaryDirectory() as folder:
        run.trainer(RunFolder(Path(folder) / "run"), [album]).fit()
    captions, rendered, drawn = zip(*album.panels, strict=True)
    return sheet(file, [list(rendered), list(drawn)], list(captions))


def photos(file: Path) -> Path:
    """Some photos of the built-in scene."""
    registry = installed()
    run = compose(resolve(registry, [Layer("the script", {"method": "3dgs"})]), registry)
    batches = run.parts.data.load(Split.TRAIN, PHOTOS, torch.device("cpu"))
    white = torch.ones(3)
    return sheet(file, [[picture(image) for batch in batches for image in batch.target(white)]], [])


def sheet(file: Path, rows: list[list[Image.Image]], captions: list[str]) -> Path:
    """Panels in rows, with a line of captions above."""
    top = 22 if captions else 0
    whole = Image.new("RGB", (len(rows[0]) * WIDTH, top + len(rows) * HEIGHT), "white")
    pen, font = ImageDraw.Draw(whole), ImageFont.load_default(13)
    for row, panels in enumerate(rows):
        for column, panel in enumerate(panels):
            whole.paste(panel, (column * WIDTH, top + row * HEIGHT))
    for column, caption in enumerate(captions):
        pen.text(((column + 0.5) * WIDTH, top / 2), caption, "#3c3c40", font, anchor="mm")
    whole.save(file, quality=82, subsampling=0)
    return file


def report(run: Path, file: Path) -> Path | None:
    """The upper part of the run's report, as a browser shows it; ``None`` without a browser."""
    if RunFolder(run).latest_checkpoint() is None and gsfw(["train", "method=3dgs", f"out={run}"]):
        raise SystemExit("the training failed")
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        shot = Path(folder) / "report.png"
        subprocess.run(
            [
                *(browser, "--headless", "--no-sandbox", "--hide-scrollbars", "--disable-gpu"),
                *(f"--user-data-dir={folder}/profile", f"--window-size={WINDOW}"),
                *(f"--screenshot={shot}", (run / "report.html").resolve().as_uri()),
            ],
            check=True,
            capture_output=True,
        )
        page = Image.open(shot).convert("RGB")
    page.resize((page.width * 3 // 4, page.height * 3 // 4), Image.Resampling.LANCZOS).save(
        file, quality=80
    )
    return file


def main(out: Path, run: Path) -> None:
    """Make all pictures, and check their sizes."""
    out.mkdir(parents=True, exist_ok=True)
    made = [
        *(photos(out / "first-photos.jpg"), growth(out / "first-growth.jpg")),
        report(run, out / "first-report.jpg"),
    ]
    for file in filter(None, made):
        say_size(file, MOST_BYTES)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", nargs="?", type=Path, default=Path("docs/images"))
    parser.add_argument("run", nargs="?", type=Path)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        main(given.folder, given.run or Path(temporary) / "run")
