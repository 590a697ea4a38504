"""Sessions of the viewer on small models, served in a thread."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from gsfw.core.batch import Batch
from gsfw.core.column import Column
from gsfw.core.datamanager import DataManager, Split, Views
from gsfw.core.maths.similarity import Similarity
from gsfw.core.model import PrimitiveModel
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings
from gsfw.core.scene import Scene
from gsfw.core.splats import Splats
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.viewer.page import Pages
from gsfw.viewer.server import ViewerServer, bound
from gsfw.viewer.session import Session, serve
from gsfw.viewer.viewed_model import ViewedModel
from support.moving_scene import two_balls
from support.scenes import front_camera, random_splats

BLACK = RenderSettings(background=torch.zeros(3))


class FixedSplats(PrimitiveModel):
    """Splats that neither move nor train."""

    def __init__(self, splats: Splats) -> None:
        super().__init__()
        self._splats = splats
        self._columns = {"means": Column(splats.means)}

    def columns(self) -> Mapping[str, Column]:
        return self._columns

    def splats(self, time=None, cameras=None) -> Splats:
        return self._splats


class OneView(DataManager):
    """A data set of one photo, of one colour."""

    def __init__(
        self,
        color: tuple[float, float, float],
        placed: Similarity | None = None,
        name: str = "one.png",
        time: float | None = None,
    ) -> None:
        moment = None if time is None else torch.tensor([time])
        self._camera = replace(front_camera(32, 24), time=moment)
        self._color, self._name = torch.tensor(color), name
        self._placed = placed or Similarity()

    @property
    def scene(self) -> Scene:
        return scene(self._placed)

    def views(self, split: Split) -> Views:
        return Views((self._name,), (self._camera,)) if split is Split.TRAIN else Views((), ())

    def load(self, split, indices, device):
        image = self._color.expand(1, 24, 32, 3)
        return [Batch(image, self._camera, tuple(indices))]


def scene(placed: Similarity | None = None) -> Scene:
    nothing, world = torch.zeros(0, 3), placed or Similarity()
    return Scene("small", nothing, nothing, torch.zeros(1, 3), 1.0, world_from_scene=world)


def still_model(
    name: str = "small", count: int = 40, seed: int = 0, rasterizer: Rasterizer | None = None
) -> ViewedModel:
    """A static model without cameras."""
    splats = FixedSplats(random_splats(count, seed=seed))
    drawn = rasterizer or ReferenceRasterizer()
    nobody = OneView((0.0, 0.0, 0.0))
    return ViewedModel(
        name, splats, drawn, BLACK, scene(), torch.device("cpu"), nobody, has_cameras=False
    )


def captured_model(color=(0.5, 0.5, 0.5), **changes) -> ViewedModel:
    """A static model with one captured view, whose photo has one colour."""
    return replace(still_model(), data=OneView(color), has_cameras=True, **changes)


def moving_model(rasterizer: Rasterizer | None = None) -> ViewedModel:
    """Two balls that move apart."""
    return ViewedModel(
        "balls",
        two_balls(),
        rasterizer or ReferenceRasterizer(),
        BLACK,
        scene(),
        torch.device("cpu"),
        OneView((0.0, 0.0, 0.0)),
        is_dynamic=True,
        has_cameras=False,
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
    session = Session(models, folder, str(folder))
    server = ViewerServer(bound(unused_port()))
    pages, ended = Pages(session), threading.Event()
    server.start(session, pages)
    thread = threading.Thread(target=serve, args=(session, ended.is_set))
    thread.start()
    try:
        yield Served(session, server, thread)
    finally:
        ended.set()
        thread.join(30)
        session.service.close()
        pages.close()
        server.close()
