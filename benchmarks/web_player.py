"""Measure the web player in headless Chromium, whose WebGL is software: bytes, speed, fidelity.

For each number of splats a ball of them at SH degree 3 is written as a page, opened from disk, and
turned around for some seconds. Real graphics cards are faster by orders of magnitude; the figures
compare versions of the player on one machine. The page of a run is also compared with the run's own
render of its held-out views, each at its time.

    PYTHONPATH=tests python benchmarks/web_player.py 20000 100000
    PYTHONPATH=tests python benchmarks/web_player.py --page scene.html
    PYTHONPATH=tests python benchmarks/web_player.py --run runs/fox
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from support.chromium import Chromium, Page, chromium
from support.web_player import Player, psnr
from support.web_scenes import ball

from gsfw.commands.interface.runs import find_run, restore_run
from gsfw.core.datamanager import Split
from gsfw.core.loop.evaluation import render_model
from gsfw.formats.web.html import HtmlExporter
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import RunSource, data_times

SIZE = (640, 360)
SECONDS = 6.0

TURN = """new Promise((resolve) => {
  const end = performance.now() + 1000 * SECONDS, begin = performance.now();
  let images = 0, sorted = 0, number = -1;
  const { scene } = page, pixel = new Uint8Array(4);
  const gl = page.canvas.getContext("webgl2");
  const look = () => {
    scene.camera.orbit(0.03, 0);
    scene.change();
    scene.draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);  // Waits for the image.
    images += 1;
    const now = performance.now();
    if (now < end) setTimeout(look, 0);
    else resolve({ rate: 1000 * images / (now - begin), sort: scene.milliseconds });
  };
  look();
})""".replace("SECONDS", str(SECONDS))
"""Turns the camera, and waits for every image: images a second without the screen's rhythm."""


def measure(browser: Chromium, path: Path) -> dict[str, Any]:
    """Figures of a page."""
    page: Page = browser.open(size=SIZE)
    begin = time.perf_counter()
    page.open(path.as_uri())
    player = Player(page)
    loaded = time.perf_counter() - begin
    found = page.evaluate(TURN)
    splats = player.stats()["splats"]
    page.close()
    return {"splats": splats, "bytes": path.stat().st_size, "seconds": loaded, **found}


@torch.no_grad()
def fidelity(browser: Chromium, path: Path, restored: Restored) -> list[float]:
    """PSNR in dB of the page against the run's own render, of each held-out view at its time."""
    composition = restored.composition
    parts, world = composition.parts, composition.scene.world_from_scene
    page, found = browser.open(size=SIZE), []
    page.open(path.as_uri())
    player = Player(page)
    for camera in parts.data.views(Split.EVAL).cameras:
        time = None if camera.time is None else camera.time[0]
        settings = composition.plan.settings
        expected = render_model(parts.model, parts.rasterizer, camera, settings, time).color[0]
        wide = camera.to(dtype=torch.float64)
        placed = replace(wide, world_to_camera=world.camera(wide.world_to_camera))
        image = player.look(placed, None if time is None else float(time))
        found.append(psnr(image, expected.clamp(0, 1).numpy()))
    page.close()
    return found


def main() -> None:
    """Print a table of the pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("counts", nargs="*", type=int, default=[], help="numbers of splats")
    parser.add_argument("--page", type=Path, action="append", default=[], help="a page to measure")
    parser.add_argument("--run", action="append", default=[], help="a run to measure on the CPU")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, chromium(Path(folder) / "profile") as browser:
        pages = [path.absolute() for path in options.page]
        for count in options.counts:
            pages.append(Path(folder) / f"{count}.html")
            content = ball(count)
            content.splats.scales.mul_((2000 / count) ** 0.5)  # type: ignore[union-attr]
            HtmlExporter().write(pages[-1], content)
        runs = {}
        for text in options.run:
            restored = restore_run(find_run(text, print), installed())
            pages.append(Path(folder) / f"run{len(runs)}.html")
            source = RunSource(restored, times=data_times(restored.composition))
            HtmlExporter().write(pages[-1], source)
            runs[pages[-1]] = text, restored
        print("| splats | page | bytes a splat | shown after | images/s | sort |")
        print("|---|---|---|---|---|---|")
        for path in pages:
            found = measure(browser, path)
            print(
                f"| {found['splats']:,} | {found['bytes'] / 1e6:.1f} MB "
                f"| {found['bytes'] / found['splats']:.0f} | {found['seconds']:.1f} s "
                f"| {found['rate']:.1f} | {found['sort']:.1f} ms |"
            )
        for path, (text, restored) in runs.items():
            each = fidelity(browser, path, restored)
            print(f"{text}: {len(each)} held-out views, {min(each):.1f} to {max(each):.1f} dB")


if __name__ == "__main__":
    main()
