"""A page of the web player in a browser: steered, and compared with our own rasterizer."""

import base64
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from gsfw.core.cameras import Cameras
from gsfw.core.render_settings import RenderSettings
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from support.chromium import Page

ALLOWED = ("GL Driver Message",)
"""What software WebGL says of itself: reading pixels back is slow."""


class Player:
    """The player of an open page."""

    def __init__(self, page: Page) -> None:
        self.page = page
        page.wait_for("!document.body.classList.contains('loading')")
        if not self.problem():
            page.evaluate("gsfw.ready.then(() => 1)")

    def look(self, camera: Cameras, time: float | None = None) -> np.ndarray:
        """The image of one camera, as [h w 3] in [0, 1]."""
        pose, lens = camera.world_to_camera[0].tolist(), camera.intrinsics[0].tolist()
        values = ", ".join(map(json.dumps, (pose, lens, camera.width, camera.height)))
        self.page.evaluate(f"gsfw.setCamera({values}).then(() => 1)")
        if time is not None:
            self.page.evaluate(f"gsfw.setTime({time}).then(() => 1)")
        return self.canvas()

    def canvas(self) -> np.ndarray:
        """The present view, as [h w 3] in [0, 1]."""
        address = self.page.evaluate("gsfw.image()")
        content = base64.b64decode(address.partition(",")[2])
        return np.asarray(Image.open(BytesIO(content)).convert("RGB")) / 255

    def stats(self) -> dict[str, Any]:
        """Figures of the moment."""
        return self.page.evaluate("gsfw.stats()")

    def forward(self) -> np.ndarray:
        """Viewing direction, after what keys and pointers started has come to rest."""
        return np.array(self._at_rest()["forward"])

    def position(self) -> np.ndarray:
        """Place of the camera in the world, at rest."""
        return np.array(self._at_rest()["position"])

    def distance(self) -> float:
        """Distance to the point that the camera turns around, at rest."""
        return float(self._at_rest()["distance"])

    def _at_rest(self) -> dict[str, Any]:
        """The figures, once two images after one another show the same view."""
        return self.page.evaluate(
            """new Promise((resolve) => {
              const pose = () => JSON.stringify([gsfw.stats().position, gsfw.stats().forward]);
              const look = (before) => requestAnimationFrame(() => requestAnimationFrame(() =>
                pose() === before ? resolve(gsfw.stats()) : look(pose())));
              look("");
            })"""
        )

    def problem(self) -> str:
        """The message of the page about what is wrong; empty if nothing is."""
        return str(
            self.page.evaluate(
                "(() => { const place = document.getElementById('problem');"
                " return place.hidden ? '' : place.textContent; })()"
            )
        )

    def check_quiet(self, own: str) -> None:
        """Check that the page asked for nothing but itself, and that its console has no error."""
        assert set(self.page.requests()) == {own}
        assert not self.page.errors(ALLOWED)


@contextmanager
def watching(page: Page, path: Path) -> Iterator[Player]:
    """Open a page from disk; it must stay quiet."""
    page.open(path.as_uri())
    player = Player(page)
    yield player
    player.check_quiet(path.as_uri())


def rendered(
    splats: Splats,
    camera: Cameras,
    antialias: bool = False,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """The image of our own rasterizer, clamped to [0, 1]."""
    settings = RenderSettings(
        antialias=antialias, background=torch.tensor(background, dtype=torch.float64)
    )
    image = ReferenceRasterizer().render(
        splats.map(lambda tensor: tensor.double()), camera, settings
    )
    return image.color[0].clamp(0, 1).numpy()


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    """Peak signal-to-noise ratio of two images, in dB."""
    return -10 * math.log10(max(float(((one - other) ** 2).mean()), 1e-12))
