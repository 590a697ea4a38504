"""PlayCanvas (MIT), an engine that is not ours, in Chromium, to show levels of streamed SOG."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from support.chromium import Page
from support.spark import opened_page
from support.splat_transform import npm_install

VERSION = "2.23.3"
FOLDER = Path(tempfile.gettempdir()) / f"gsfw-playcanvas-{VERSION}-{os.getuid()}"

PAGE = """<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<style>body { margin: 0; background: black }</style><canvas></canvas>
<script type="module">
import * as pc from "/node_modules/playcanvas/build/playcanvas.mjs";

const canvas = document.querySelector("canvas");
const graphicsDeviceOptions = { antialias: false, preserveDrawingBuffer: true, alpha: false };
const app = new pc.Application(canvas, { graphicsDeviceOptions });
app.setCanvasFillMode(pc.FILLMODE_NONE);
app.start();
const camera = new pc.Entity();
camera.addComponent("camera", {
  clearColor: pc.Color.BLACK, nearClip: 0.01, farClip: 1000, toneMapping: pc.TONEMAP_NONE,
});
app.root.addChild(camera);
let shown;

// Shows one level of the scene alone.
window.load = (url, level) => new Promise((done, fail) => {
  shown?.destroy();
  const asset = new pc.Asset(`level ${level}`, "gsplat", { url });
  asset.on("error", fail);
  asset.on("load", () => {
    shown = new pc.Entity();
    shown.addComponent("gsplat", { asset, unified: true });
    shown.gsplat.lodRangeMin = shown.gsplat.lodRangeMax = level;
    app.root.addChild(shown);
    done(true);
  });
  app.assets.add(asset);
  app.assets.load(asset);
});

// `pose` leads from the camera (x right, y up, z back) to the world, row by row.
window.look = async (pose, angle, width, height) => {
  app.setCanvasResolution(pc.RESOLUTION_FIXED, width, height);
  camera.camera.fov = angle;
  const matrix = new pc.Mat4();
  matrix.set(pose);
  matrix.transpose();
  camera.setPosition(matrix.getTranslation());
  camera.setRotation(new pc.Quat().setFromMat4(matrix));
  for (let count = 0; count < 60; count++) {  // Files are loaded and splats sorted meanwhile.
    await new Promise((done) => setTimeout(() => requestAnimationFrame(done), 30));
  }
  return canvas.toDataURL("image/png");
};
window.started = true;
</script>"""


@contextmanager
def playcanvas_viewer(folder: Path, profile: Path) -> Iterator[Page]:
    """Open the page.

    Args:
        folder: of the scenes to show, served below ``files``.
        profile: an empty folder for the browser.
    """
    npm_install(FOLDER, f"playcanvas@{VERSION}")
    with opened_page(PAGE, FOLDER, folder, profile) as page:
        yield page
