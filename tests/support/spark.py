"""Spark (World Labs, MIT) on three.js: a viewer that is not ours, in Chromium, to show our files.

npm installs both on first use into a folder of the system's temporary files; a server on this
machine gives them to the page.
"""

from __future__ import annotations

import base64
import json
import os
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from gsfw.core.cameras import Cameras
from support.chromium import Page, chromium
from support.splat_transform import npm_install

SPARK, THREE = "2.2.0", "0.180.0"
FOLDER = Path(tempfile.gettempdir()) / f"gsfw-spark-{SPARK}-{THREE}-{os.getuid()}"

PAGE = """<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
<style>body { margin: 0; background: black }</style>
<script type="importmap">{"imports": {
  "three": "/node_modules/three/build/three.module.js",
  "three/addons/": "/node_modules/three/examples/jsm/",
  "@sparkjsdev/spark": "/node_modules/@sparkjsdev/spark/dist/spark.module.js"}}</script>
<script type="module">
import * as THREE from "three";
import { SparkRenderer, SplatMesh } from "@sparkjsdev/spark";

const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
document.body.appendChild(renderer.domElement);
let scene, spark, mesh;

// Dilation as in the original 3DGS, and its order by depth.
window.load = async (url, upright) => {
  scene = new THREE.Scene();
  spark = new SparkRenderer({ renderer, preBlurAmount: 0.3, blurAmount: 0, sortRadial: false });
  mesh = new SplatMesh({ url });
  await mesh.initialized;
  if (upright) mesh.rotation.x = Math.PI;
  scene.add(spark, mesh);
  return mesh.numSplats ?? mesh.packedSplats?.numSplats;
};

// `pose` leads from the camera (x right, y up, z back) to the world, row by row.
window.look = async (pose, angle, width, height) => {
  renderer.setPixelRatio(1);
  renderer.setSize(width, height);
  const camera = new THREE.PerspectiveCamera(angle, width / height, 0.01, 1000);
  new THREE.Matrix4().set(...pose).decompose(camera.position, camera.quaternion, camera.scale);
  camera.updateMatrixWorld();
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  for (let count = 0; count < 12; count++) {  // Splats are sorted in a worker meanwhile.
    renderer.render(scene, camera);
    await frame();
    await new Promise((done) => setTimeout(done, 30));
  }
  renderer.render(scene, camera);
  return renderer.domElement.toDataURL("image/png");
};
window.started = true;
</script>"""


@dataclass(frozen=True)
class SparkViewer:
    """The open page."""

    page: Page
    folder: Path
    """Served at the page's address, below ``files``."""

    def load(self, path: Path, upright: bool) -> int:
        """Show a file of ``folder`` alone; the number of its splats.

        Args:
            path: the file.
            upright: turn it by half a turn about x: from SPZ's axes to those of the other formats.
        """
        address = json.dumps(f"/files/{path.relative_to(self.folder).as_posix()}")
        return int(self.page.evaluate(f"load({address}, {json.dumps(upright)})"))

    def look(self, camera: Cameras) -> np.ndarray:
        """The image of one camera, [h w 3] in [0, 1]."""
        return image_in(self.page, camera)


def image_in(page: Page, camera: Cameras) -> np.ndarray:
    """The image of one camera, [h w 3] in [0, 1], by ``look`` of a page."""
    to_world = torch.linalg.inv(camera.world_to_camera[0].double())
    pose = (to_world @ torch.diag(torch.tensor([1.0, -1.0, -1.0, 1.0]).double())).flatten()
    focal = float(camera.intrinsics[0, 1, 1])
    angle = float(np.degrees(2 * np.arctan(camera.height / 2 / focal)))
    values = ", ".join(map(json.dumps, (pose.tolist(), angle, camera.width, camera.height)))
    address = page.evaluate(f"look({values})")
    image = Image.open(BytesIO(base64.b64decode(address.partition(",")[2])))
    return np.asarray(image.convert("RGB")) / 255


class _Handler(SimpleHTTPRequestHandler):
    """Serves the page, the packages and the files; says nothing."""

    def __init__(self, *arguments: object, packages: Path, files: Path, **named: object) -> None:
        self._packages, self._files = packages, files
        super().__init__(*arguments, **named)

    def translate_path(self, path: str) -> str:
        """The file of an address."""
        inner = path.split("?", maxsplit=1)[0].lstrip("/")
        root = self._files if inner.startswith("files/") else self._packages
        return str(root / inner.removeprefix("files/"))

    def log_message(self, *_: object) -> None:
        """Print nothing."""


@contextmanager
def spark_viewer(folder: Path, profile: Path) -> Iterator[SparkViewer]:
    """Open the page.

    Args:
        folder: of the files to show.
        profile: an empty folder for the browser.
    """
    npm_install(FOLDER, f"@sparkjsdev/spark@{SPARK}", f"three@{THREE}")
    with opened_page(PAGE, FOLDER, folder, profile) as page:
        yield SparkViewer(page, folder)


@contextmanager
def opened_page(text: str, packages: Path, files: Path, profile: Path) -> Iterator[Page]:
    """Open a page that sets ``started``.

    Args:
        text: the page.
        packages: the folder of ``node_modules``.
        files: served below ``files``.
        profile: an empty folder for the browser.
    """
    (packages / "page.html").write_text(text)
    handler = partial(_Handler, packages=packages, files=files)
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        with chromium(profile) as browser:
            page = browser.open(f"http://127.0.0.1:{server.server_port}/page.html", (400, 300))
            page.wait_for("window.started")
            yield page
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
