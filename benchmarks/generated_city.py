"""GeneratedCity: tiles of the built-in scene on one ground, photographed from the air.

Images are ray-cast analytically and written as they are made, as a transforms.json with points in
double precision; a city of thousands of views takes no more memory than one of a few.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.color_bytes import color_bytes
from gsfw.core.files.ply_file import ply_header
from gsfw.core.one_thread import one_thread
from gsfw.datamanagers.synthetic.motion import Pose, Still
from gsfw.datamanagers.synthetic.raycast import photograph, rays
from gsfw.datamanagers.synthetic.scene import Solid, SyntheticScene, solids
from gsfw.datamanagers.synthetic.shapes import Box
from gsfw.datamanagers.synthetic.textures import Checker, Waves

SPACING = 3.4
"""Distance between the middles of tiles; the table of a tile has a radius of 1.5."""
HEIGHT, DOWNWARDS, FIELD_OF_VIEW = 3.4, 50.0, 55.0
"""Height of the cameras, degrees that they look below the horizon, and degrees from left to right:
no ray meets the horizon, and the farthest ones end within ``REACH``."""
REACH = 12.0
"""Distance from a camera beyond which no tile is in its image."""
STYLES = 5
"""Different sets of textures, which take turns."""
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class City:
    """Sizes of a generated city."""

    tiles: tuple[int, int] = (2, 2)
    views: int = 24
    """Views of each tile."""
    width: int = 96
    height: int = 72
    points: int = 2000
    """Points of each tile."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Place of the city in the world, as of georeferenced data."""
    seed: int = 0

    @property
    def middles(self) -> list[tuple[float, float]]:
        """The middle of each tile."""
        return [
            (SPACING * (x - (self.tiles[0] - 1) / 2), SPACING * (y - (self.tiles[1] - 1) / 2))
            for x in range(self.tiles[0])
            for y in range(self.tiles[1])
        ]


@dataclass(frozen=True)
class _Shifted:
    """A motion that stands elsewhere, and stands still."""

    given: Callable[[float], Pose]
    by: tuple[float, float]

    def __call__(self, time: float) -> Pose:
        pose = self.given(0.0)
        return replace(pose, center=pose.center + torch.tensor([*self.by, 0.0]).double())


def write_city(
    city: City, folder: Path, advance: Callable[[int, int], None] = lambda done, total: None
) -> Path:
    """Photograph a city into a folder; return it.

    Args:
        city: its sizes.
        folder: is created.
        advance: told the number of images that are there, and that of all.
    """
    (folder / "images").mkdir(parents=True, exist_ok=True)
    styles = [solids(city.seed + style) for style in range(STYLES)]
    ground, cameras = _ground(city), _cameras(city)
    generator = torch.Generator().manual_seed(city.seed)
    each = -(-city.points * len(city.middles) // len(cameras))
    frames, points, colors = [], [], []
    with one_thread():
        for number, camera in enumerate(cameras):
            scene = SyntheticScene((ground, *_near(city, camera, styles)), 0.0)
            image = photograph(scene, camera)[..., :3]
            name = f"images/{number:05d}.png"
            Image.fromarray(image.numpy()).save(folder / name)
            frames.append({"file_path": name, "transform_matrix": _pose(camera, city)})
            found, seen = _surface(scene, camera, each, generator)
            points.append(found)
            colors.append(seen)
            advance(number + 1, len(cameras))
    _write_points(folder / "points.ply", torch.cat(points), torch.cat(colors), city)
    matrix = cameras[0].intrinsics[0]
    document = {
        **{"fl_x": float(matrix[0, 0]), "fl_y": float(matrix[1, 1])},
        **{"cx": float(matrix[0, 2]), "cy": float(matrix[1, 2])},
        **{"w": city.width, "h": city.height, "ply_file_path": "points.ply", "frames": frames},
    }
    (folder / "transforms.json").write_text(json.dumps(document))
    return folder


def city_scene(city: City, camera: Cameras) -> SyntheticScene:
    """View of a camera of a city, in its world without the origin."""
    styles = [solids(city.seed + style) for style in range(STYLES)]
    return SyntheticScene((_ground(city), *_near(city, camera, styles)), 0.0)


def _ground(city: City) -> Solid:
    half = [SPACING * count / 2 + REACH + SPACING for count in city.tiles]
    generator = torch.Generator().manual_seed(city.seed + 1000)
    texture = Checker(
        (0.55, 0.58, 0.5), (0.4, 0.42, 0.38), (0.5, 0.5, 0.5), max(half) / 2,
        Waves.random(generator, 2 * max(half)),
    )  # fmt: skip
    size = max(half)
    return Solid("ground", Box(), Still((0.0, 0.0, -0.3), (size, size, 0.2)), texture)


def _near(city: City, camera: Cameras, styles: list[tuple[Solid, ...]]) -> list[Solid]:
    """The solids of the tiles that may be in an image."""
    x, y, _ = camera.centers[0].tolist()
    return [
        replace(solid, motion=_Shifted(solid.motion, middle))
        for number, middle in enumerate(city.middles)
        if (middle[0] - x) ** 2 + (middle[1] - y) ** 2 < REACH**2
        for solid in styles[number % STYLES]
        if solid.is_present(0.0)
    ]


def _cameras(city: City) -> list[Cameras]:
    """Cameras over every tile that look in all directions."""
    generator = torch.Generator().manual_seed(city.seed + 1)
    down = float(np.radians(DOWNWARDS))
    found = []
    for middle in city.middles:
        for number in range(city.views):
            turn = 2 * np.pi * (number + float(torch.rand(1, generator=generator))) * 0.618034
            place = (torch.rand(3, generator=generator).double() - 0.5) * SPACING
            ahead = np.array([np.cos(turn), np.sin(turn)])
            # What is in the middle of the image lies over the tile.
            back = HEIGHT / np.tan(down)
            center = torch.tensor(
                [
                    middle[0] + float(place[0]) - back * ahead[0],
                    middle[1] + float(place[1]) - back * ahead[1],
                    HEIGHT + 0.3 * float(place[2]),
                ],
                dtype=torch.float64,
            )
            target = center + torch.tensor([*(ahead * back), -HEIGHT], dtype=torch.float64)
            found.append(
                Cameras.look_at(
                    center, target, up=(0.0, 0.0, 1.0), width=city.width, height=city.height,
                    field_of_view=FIELD_OF_VIEW,
                )
            )  # fmt: skip
    return found


def _pose(camera: Cameras, city: City) -> list[list[float]]:
    """The camera-to-world matrix of OpenGL, at the city's place in the world."""
    pose = np.linalg.inv(camera.world_to_camera[0].double().numpy())
    pose[:3, 3] += np.array(city.origin)
    return (pose @ OPENGL).tolist()


def _surface(
    scene: SyntheticScene, camera: Cameras, count: int, generator: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Random points that a camera sees, and their colours."""
    size = torch.tensor([[camera.width], [camera.height]], dtype=torch.float64)
    pixels = torch.rand(2, count, generator=generator, dtype=torch.float64) * size
    origin, directions = rays(camera, pixels)
    hits = scene.trace(origin, directions)
    met = hits.solid >= 0
    return hits.points.T[met], scene.shade(hits, directions).T[met]


def _write_points(path: Path, points: Tensor, colors: Tensor, city: City) -> None:
    records = np.empty(len(points), [("place", "<f8", 3), ("color", "u1", 3)])
    records["place"] = points.numpy() + np.array(city.origin)
    records["color"] = color_bytes(colors).numpy()
    kinds = [
        *(("double", axis) for axis in "xyz"),
        *(("uchar", c) for c in ("red", "green", "blue")),
    ]
    header = ply_header(["Generated city of gsfw"], {"vertex": (len(points), kinds)})
    path.write_bytes(header + records.tobytes())
