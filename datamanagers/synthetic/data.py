"""The data manager of the built-in scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Float64
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, DataRequest, Split, Views
from gsfw.core.maths.similarity import Similarity
from gsfw.core.one_thread import one_thread
from gsfw.core.scene import Scene
from gsfw.datamanagers.image_cache import ImageCache
from gsfw.datamanagers.images import DecodedImage
from gsfw.datamanagers.loader import Loader
from gsfw.datamanagers.scene_frame import scene_frame
from gsfw.datamanagers.synthetic.config import SyntheticConfig
from gsfw.datamanagers.synthetic.dome import HELD_OUT, dome
from gsfw.datamanagers.synthetic.raycast import photograph, rays, show_change
from gsfw.datamanagers.synthetic.scene import Solid, SyntheticScene, solids
from gsfw.datamanagers.synthetic.tracks import Marks, Tracks


@dataclass(frozen=True)
class SurfacePoints:
    """Points that rays of the training views have met."""

    marks: Marks
    world: Float64[Tensor, "p 3"]
    """Positions at the time of the view that saw them."""
    colors: Float[Tensor, "p 3"]
    """Colours that this view saw."""
    times: Float[Tensor, " p"]
    """Time of that view."""


class SyntheticData(DataManager):
    """Images of the built-in scene, cast when they are first asked for and held as 8-bit RGBA."""

    def __init__(self, config: SyntheticConfig, request: DataRequest) -> None:
        self._config = config
        self._solids = solids(config.seed)
        self._world = world = {
            Split.TRAIN: self._cameras(config.views, 0.0, request.downscale),
            Split.EVAL: self._cameras(config.eval_views, HELD_OUT, request.downscale),
        }
        with one_thread():
            surface = find_surface(self._solids, world[Split.TRAIN], config.points, config.seed)
        self._marks = surface.marks
        poses = torch.cat([camera.world_to_camera for camera in world[Split.TRAIN]])
        frame, extent = scene_frame(poses, surface.world)
        self._views = {split: self._in_scene(split, world[split], frame) for split in Split}
        sizes = [camera.width * camera.height * 4 for split in Split for camera in world[split]]
        self._loader = Loader(
            self._views,
            ImageCache(self._cast, sizes, sum(sizes)),
            request.gpu_cache_megabytes * 1_000_000,
        )
        self._scene = Scene(
            name="synthetic-moving" if config.moving else "synthetic",
            points=frame.apply(surface.world).float(),
            point_colors=surface.colors,
            camera_centers=torch.cat([c.centers for c in self._views[Split.TRAIN].cameras]),
            extent=extent,
            world_from_scene=frame.inverse(),
            point_times=surface.times if config.moving else None,
            time_range=(0.0, 1.0) if config.moving else None,
            num_times=config.times if config.moving else 0,
            has_alpha=True,
            up="z",
            view_pixels=self._views[Split.TRAIN].pixels,
        )

    def _cast(self, number: int) -> DecodedImage:
        """The image of a view, by its number; called from several threads."""
        views = [*self._world[Split.TRAIN], *self._world[Split.EVAL]]
        scene = SyntheticScene(self._solids, _time(views[number]))
        with one_thread():
            return DecodedImage(photograph(scene, views[number]).numpy())

    def _cameras(self, count: int, first: float, downscale: float) -> list[Cameras]:
        """Views in the world, in float64, in order of time; every time gets about as many."""
        config = self._config
        cameras = dome(count, first, config.width, config.height, config.seed)
        width, height = (max(1, round(side / downscale)) for side in (config.width, config.height))
        cameras = cameras.resized(width, height)
        if config.moving:
            instant = torch.arange(count) * config.times // max(count, 1)
            cameras = replace(cameras, time=instant.double() / (config.times - 1))
        return [cameras.select([index]) for index in range(count)]

    def _in_scene(self, split: Split, world: Sequence[Cameras], frame: Similarity) -> Views:
        """The views in the scene frame, in float32, with names and numbers."""
        cameras = [
            replace(
                camera,
                world_to_camera=frame.camera(camera.world_to_camera),
            ).to(dtype=torch.float32)
            for camera in world
        ]
        names = tuple(f"{split.value}_{index:03d}" for index in range(len(world)))
        return Views(names, tuple(cameras), "cameras of their own")

    @property
    def scene(self) -> Scene:
        """The scene before training, in the scene frame."""
        return self._scene

    def views(self, split: Split) -> Views:
        """The views of a split; in order of time where solids move."""
        return self._views[split]

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Batches of images; one that was not asked for before is cast."""
        return self._loader.load(split, indices, device)

    def prefetch(self, split: Split, indices: Sequence[int]) -> None:
        """Start casting them, and sending them to a GPU."""
        self._loader.prefetch(split, indices)

    def moving_mask(self, split: Split, index: int) -> Bool[Tensor, "h w 1"] | None:
        """Pixels of a view that show a solid that moves, deforms or vanishes, at any time."""
        if not self._config.moving:
            return None
        times = [number / (self._config.times - 1) for number in range(self._config.times)]
        with one_thread():
            scenes = [SyntheticScene(self._solids, time) for time in times]
            return show_change(scenes, self._world[split][index])

    def drop_images(self) -> int:
        """Keep half as many decoded images from now on; returns the bytes that are free now."""
        return self._loader.drop_images()

    def close(self) -> None:
        """Stop casting, and free the images."""
        self._loader.close()

    def notes(self) -> tuple[str, ...]:
        """Description of the scene."""
        config = self._config
        moving = f" at {config.times} times" if config.moving else ""
        return (
            f"the built-in scene is ray-cast{moving}",
            *self._loader.notes(),
        )

    def tracks(self, times: Sequence[float]) -> Tracks:
        """The true paths of ``scene.points``, in the scene frame, at times in [0, 1]."""
        tracks = self._marks.tracks(self._solids, times)
        frame = self._scene.world_from_scene.inverse()
        return replace(tracks, positions=frame.apply(tracks.positions))


def _time(camera: Cameras) -> float:
    return 0.0 if camera.time is None else float(camera.time[0])


def find_surface(
    items: tuple[Solid, ...], cameras: Sequence[Cameras], count: int, seed: int
) -> SurfacePoints:
    """``count`` random points that are visible from ``cameras``, in their world.

    Random rays of every view are cast, in float64, until enough have met something.
    """
    generator = torch.Generator().manual_seed(seed)
    found: list[Tensor] = [torch.zeros(0, 11, dtype=torch.float64)]
    while sum(map(len, found)) < count:
        for time in sorted({_time(camera) for camera in cameras}):
            cast = [
                _random_rays(camera, 64 + count // len(cameras), generator)
                for camera in cameras
                if _time(camera) == time
            ]
            origins, directions = (torch.cat(part, dim=1) for part in zip(*cast, strict=True))
            found.append(_met(SyntheticScene(items, time), origins, directions))
    rows = torch.cat(found)
    rows = rows[torch.randperm(len(rows), generator=generator)[:count]]
    solid, own, world, colors, times = rows.split([1, 3, 3, 3, 1], dim=1)
    marks = Marks(solid[:, 0].long(), own.contiguous())  # Not a view of all rows.
    return SurfacePoints(marks, world, colors.float(), times[:, 0].float())


def _random_rays(
    camera: Cameras, count: int, generator: torch.Generator
) -> tuple[Float64[Tensor, "3 n"], Float64[Tensor, "3 n"]]:
    size = torch.tensor([[camera.width], [camera.height]], dtype=torch.float64)
    draws = torch.rand(2, count, generator=generator, dtype=torch.float64)
    origin, directions = rays(camera, size * draws)
    return origin.expand_as(directions), directions


def _met(
    scene: SyntheticScene, origins: Float64[Tensor, "3 n"], directions: Float64[Tensor, "3 n"]
) -> Float64[Tensor, "hits 11"]:
    """Hits of rays: solid, point in its own coordinates, point in the world, colour, time."""
    hits = scene.trace(origins, directions)
    colors = scene.shade(hits, directions)
    rows = []
    for index, _, pose in scene.placed:
        chosen = hits.solid == index
        world = hits.points[:, chosen]
        number, time = torch.full_like(world[:1], index), torch.full_like(world[:1], scene.time)
        rows.append(torch.cat([number, pose.to_own(world), world, colors[:, chosen], time]).T)
    return torch.cat(rows)
