"""Sessions of the viewer on small models, served in a thread."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import torch

from gsfw.core.batch import Batch
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.viewer.opening import FixedSplats
from gsfw.viewer.page import Pages
from gsfw.viewer.server import ViewerServer
from gsfw.viewer.session import Session, serve
from gsfw.viewer.viewed_model import ViewedModel
from support.moving_scene import two_balls
from support.scenes import front_camera, random_splats

BLACK = RenderSettings(background=torch.zeros(3))


class OneView(DataManager):
    """A data set of one photo, of one colour."""

    def __init__(self, color: tuple[float, float, float]) -> None:
        self._camera = front_camera(32, 24)
        self._color = torch.tensor(color)

    @property
    def scene(self) -> Scene:
        return scene()

    def views(self, split: Split) -> Views:
        return Views(("one.png",), (self._camera,)) if split is Split.TRAIN else Views((), ())

    def load(self, split, indices, device):
        image = self._color.expand(1, 24, 32, 3)
        return [Batch(image, self._camera, tuple(indices))]


def scene() -> Scene:
    nothing = torch.zeros(0, 3)
    return Scene("small", nothing, nothing, torch.zeros(1, 3), 1.0)


def still_model(
    name: str = "small", count: int = 40, seed: int = 0, rasterizer: Rasterizer | None = None
) -> ViewedModel:
    """A static model without cameras."""
    splats = FixedSplats(random_splats(count, seed=seed))
    drawn = rasterizer or ReferenceRasterizer()
    return ViewedModel(name, splats, drawn, BLACK, scene(), torch.device("cpu"))


def moving_model(rasterizer: Rasterizer | None = None) -> ViewedModel:
    """Two balls that move apart."""
    return ViewedModel(
        "balls",
        two_balls(),
        rasterizer or ReferenceRasterizer(),
        BLACK,
        scene(),
        torch.device("cpu"),
        is_dynamic=True,
    )


@dataclass
class Served:
    """A session that a thread serves."""

    session: Session
    server: ViewerServer
    thread: threading.Thread


def unused_port() -> int:
    """A port that no test had before: a browser may keep connections to an earlier server."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


@contextmanager
def served(folder: Path, *models: ViewedModel) -> Iterator[Served]:
    """Serve models until the end of the context."""
    session = Session(models, folder)
    server, pages, ended = ViewerServer(unused_port()), Pages(session), threading.Event()
    server.start(session, pages)
    thread = threading.Thread(target=serve, args=(session, ended.is_set))
    thread.start()
    try:
        yield Served(session, server, thread)
    finally:
        ended.set()
        thread.join(30)
        pages.close()
        server.close()
