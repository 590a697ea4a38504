"""Splat run: splats of any tool as a run of 3DGS that is finished, seen by cameras around them.

The model is the one that ``init=FILE`` makes, so that all that takes a run takes the splats.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Split, Views
from gsfw.core.errors import DataError
from gsfw.core.exchange import SplatFile
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.maths.axes import known_or_usual_up
from gsfw.core.maths.camera_path import look_at
from gsfw.core.maths.inner_box import inner_box
from gsfw.core.maths.similarity import Similarity
from gsfw.core.scene import Scene
from gsfw.core.splats import Sh, Splats
from gsfw.core.words import shell_argument
from gsfw.plugins.compose import compose
from gsfw.plugins.initial_splats import find_importer, in_scene
from gsfw.plugins.registry import Registry
from gsfw.plugins.restore import Restored
from gsfw.plugins.settings import Layer, resolve
from gsfw.plugins.stored_capture import StoredCapture

METHOD = "3dgs"
"""The method whose model any splats fit into."""

CAMERAS = 24
"""Cameras around the splats."""

WIDTH, HEIGHT, FIELD_OF_VIEW = 960, 540, 50.0
"""Size of an image in pixels, and field of view in degrees from left to right."""

DISTANCE, RISE = 2.2, 0.5
"""Distance of the cameras, and their height above the middle, in sizes of the scene."""


def open_splats(path: Path, registry: Registry, changed: Layer | None) -> Restored:
    """A run whose model has the splats of a file.

    Args:
        path: the file.
        registry: the installed parts.
        changed: settings that replace those of the run, such as the device.

    Raises:
        DataError: it is no splat file that can be read; names the cause.
    """
    start = _Start.of(find_importer(path, registry).read(path), path)
    return start.run(registry, {"init": str(path)}, changed)


def run_of_splats(
    content: SplatFile, path: Path, registry: Registry, changed: Layer | None
) -> Restored:
    """A run whose model has splats that are in no file yet.

    Args:
        content: the splats.
        path: the file that they are meant for, which names the scene.
        registry: the installed parts.
        changed: settings that replace those of the run, such as the device.

    Raises:
        DataError: there are none, or some are not finite.
    """
    return _Start.of(content, path).run(registry, {}, changed)


@dataclass(frozen=True)
class _Start:
    """The splats that a run begins with, and the cameras around them.

    It keeps no content of a file: that is most of the memory, in double precision.
    """

    path: Path
    capture: _SplatCapture
    splats: Splats
    """In the scene frame, float32."""
    antialiased: bool

    @staticmethod
    def of(content: SplatFile, path: Path) -> _Start:
        """Choose the scene frame, move the splats there, and put cameras around them."""
        scene, cameras = surroundings(path.stem, content)
        views = {
            Split.TRAIN: Views(tuple(f"around_{n:02d}" for n in range(len(cameras))), cameras),
            Split.EVAL: Views(("before",), cameras[:1]),
        }
        capture = _SplatCapture(scene, views, str(path), content.notes())
        return _Start(path, capture, in_scene(content, scene), content.antialiased)

    def run(self, registry: Registry, values: Mapping[str, Any], changed: Layer | None) -> Restored:
        """The run, with some settings of its own and those that replace them."""
        colors = self.splats.colors
        assert isinstance(colors, Sh), "a splat file has SH colours"
        values = {
            "method": METHOD,
            "sh_degree": colors.degree,
            "antialias": self.antialiased,
            "background": "black",
            **values,
        }
        layers = [Layer(f"splat file {self.path}", values), *([changed] if changed else [])]
        settings = resolve(registry, layers)
        composition = compose(settings, registry, data=self.capture, initial=self.splats)
        return Restored(RunFolder(self.path.parent), composition, {"step": 0})


def surroundings(name: str, content: SplatFile) -> tuple[Scene, tuple[Cameras, ...]]:
    """The scene of the splats of a file, with this name, and the cameras around it."""
    scene = _scene(name, content)
    return scene, _around(scene, known_or_usual_up(content.up))


class _SplatCapture(StoredCapture):
    """Cameras that nobody stood at."""

    def __init__(
        self, scene: Scene, views: Mapping[Split, Views], source: str, notes: tuple[str, ...]
    ) -> None:
        """Store the cameras around the splats of a file, and the notes on it."""
        super().__init__(scene, views, source, has_data=False)
        self._notes = notes

    def notes(self) -> tuple[str, ...]:
        """The notes on the file."""
        return self._notes

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Raise an error: there are no images.

        Raises:
            DataError: always; names the alternative.
        """
        raise DataError(
            f"{self._source} holds splats, and no images to compare with.",
            f"Render what needs none: gsfw render {shell_argument(self._source)} what=orbit",
        )


def _scene(name: str, content: SplatFile) -> Scene:
    """The scene: around its middle, nearly all splats within a distance of about 1."""
    ends = inner_box(content.splats.means)
    size = max(float((ends[1] - ends[0]).norm()) / 2, 1e-9)
    placed = Similarity(scale=size, translation=ends.mean(0))
    none = torch.zeros(0, 3)
    return Scene(
        name, none, none, none, extent=1.1 * DISTANCE, world_from_scene=placed, up=content.up
    )


def _around(scene: Scene, up: Float[Tensor, " 3"]) -> tuple[Cameras, ...]:
    """Cameras on a circle around the middle."""
    first = torch.linalg.cross(up, up.roll(1))
    second = torch.linalg.cross(up, first)
    angles = torch.arange(CAMERAS, dtype=torch.float64)[:, None] * (2 * math.pi / CAMERAS)
    level = math.sqrt(DISTANCE**2 - RISE**2)
    places = level * (angles.cos() * first + angles.sin() * second) + RISE * up
    poses = look_at(places, torch.zeros(3, dtype=torch.float64), up).float()
    focal = WIDTH / 2 / math.tan(math.radians(FIELD_OF_VIEW) / 2)
    intrinsics = torch.tensor([[focal, 0, WIDTH / 2], [0, focal, HEIGHT / 2], [0, 0, 1]])
    return tuple(Cameras(pose[None], intrinsics[None], WIDTH, HEIGHT) for pose in poses)
