"""Measure the web player in headless Chromium, whose WebGL is software: bytes, loading, images/s.

For each number of splats a ball of them at SH degree 3 is written as a page, opened from disk, and
turned around for some seconds. Real graphics cards are faster by orders of magnitude; the figures
compare versions of the player on one machine.

    PYTHONPATH=tests python benchmarks/web_player.py 20000 100000
    PYTHONPATH=tests python benchmarks/web_player.py --page scene.html
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any

from support.chromium import Chromium, Page, chromium
from support.web_player import Player
from support.web_scenes import ball

from gsfw.formats.web.html import HtmlExporter

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


def main() -> None:
    """Print a table of the pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("counts", nargs="*", type=int, default=[], help="numbers of splats")
    parser.add_argument("--page", type=Path, action="append", default=[], help="a page to measure")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, chromium(Path(folder) / "profile") as browser:
        pages = [path.absolute() for path in options.page]
        for count in options.counts:
            pages.append(Path(folder) / f"{count}.html")
            content = ball(count)
            content.splats.scales.mul_((2000 / count) ** 0.5)  # type: ignore[union-attr]
            HtmlExporter().write(pages[-1], content)
        print("| splats | page | bytes a splat | shown after | images/s | sort |")
        print("|---|---|---|---|---|---|")
        for path in pages:
            found = measure(browser, path)
            print(
                f"| {found['splats']:,} | {found['bytes'] / 1e6:.1f} MB "
                f"| {found['bytes'] / found['splats']:.0f} | {found['seconds']:.1f} s "
                f"| {found['rate']:.1f} | {found['sort']:.1f} ms |"
            )


if __name__ == "__main__":
    main()
