"""Capture: the data manager over the frames of a file, whatever its format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import torch
from jaxtyping import Bool
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, DataRequest, Split, Views
from gsfw.core.errors import DataError
from gsfw.core.scene import Scene
from gsfw.core.similarity import Similarity
from gsfw.datamanagers.area import shrink_mask
from gsfw.datamanagers.frames import Recording
from gsfw.datamanagers.holdout import hold_out
from gsfw.datamanagers.loader import Loader
from gsfw.datamanagers.picture_cache import PictureCache
from gsfw.datamanagers.pictures import Picture, load_mask, load_picture
from gsfw.datamanagers.scene_frame import scene_frame
from gsfw.datamanagers.timeline import Timeline


class Capture(DataManager):
    """The frames of a recording in the scene frame, with their pictures decoded as needed."""

    def __init__(self, recording: Recording, request: DataRequest) -> None:
        """Fit the cameras to their pictures, hold frames out, find the scene frame.

        Raises:
            DataError: a picture contradicts its camera, some frames have a time and some do not,
                a name is not unique, or nothing is left to train on.
        """
        self._frames = sorted(recording.frames, key=lambda frame: frame.name)
        splits, how = hold_out(self._frames, request)
        self._members = {
            split: [i for i, member in enumerate(splits) if member is split] for split in Split
        }
        self._check_members(recording)
        timeline = Timeline.of(self._frames, recording.unused_times)
        train = self._members[Split.TRAIN]
        scene_from_world, extent = scene_frame(
            torch.stack([self._frames[i].world_to_camera for i in train]), recording.points
        )
        cameras = [
            self._camera(i, request.downscale, scene_from_world, timeline)
            for i in range(len(self._frames))
        ]
        self._scene = Scene(
            name=recording.name,
            points=scene_from_world.apply(recording.points).float(),
            point_colors=recording.point_colors.float(),
            camera_centers=torch.cat([cameras[i].centers for i in train]),
            extent=extent,
            world_from_scene=scene_from_world.inverse(),
            time_range=timeline.range,
            num_times=timeline.count,
            up=recording.up,
            has_alpha=any(frame.header.has_alpha for frame in self._frames),
        )
        self._views = {
            split: Views(
                names=tuple(self._frames[i].name for i in members),
                cameras=tuple(cameras[i] for i in members),
                origin=how,
            )
            for split, members in self._members.items()
        }
        self._sizes = [(camera.width, camera.height) for camera in cameras]
        self._loader = self._make_loader(request)
        self._notes = (*recording.notes, self._split_note(how), *self._loader.notes())

    def _make_loader(self, request: DataRequest) -> Loader:
        order = [*self._members[Split.TRAIN], *self._members[Split.EVAL]]
        cache = PictureCache(
            lambda number: self._decode(order[number]),
            [self._bytes(index) for index in order],
            request.cache_megabytes * 1_000_000,
        )
        return Loader(self._views, cache, request.gpu_cache_megabytes * 1_000_000)

    def _check_members(self, recording: Recording) -> None:
        for members in self._members.values():
            for before, after in pairwise(members):
                if self._frames[before].name == self._frames[after].name:
                    raise DataError(
                        f"{recording.path}: {self._frames[after].name} is listed twice.",
                        "Remove one of its two entries.",
                    )
        if not self._members[Split.TRAIN]:
            raise DataError(
                f"{recording.path}: no view is left to train on; all {len(self._frames)} are held "
                "out.",
                "Hold out fewer images (holdout_every=0 holds out none).",
            )

    def _camera(
        self, index: int, downscale: float, scene_from_world: Similarity, timeline: Timeline
    ) -> Cameras:
        """The camera of a frame, in the scene frame."""
        frame = self._frames[index]
        camera = frame.camera_at(downscale)
        time = timeline.at(frame.time)
        return replace(
            camera,
            world_to_camera=scene_from_world.camera(camera.world_to_camera),
            time=None if time is None else torch.tensor([time], dtype=torch.float64),
            image_index=torch.tensor([index]),
            camera_index=torch.tensor([frame.camera]),
        ).to(dtype=torch.float32)

    def _split_note(self, how: str) -> str:
        train, held = (len(self._members[split]) for split in (Split.TRAIN, Split.EVAL))
        return f"{train} views to train on, {held} held out ({how})"

    @property
    def scene(self) -> Scene:
        """What is known of the capture before training."""
        return self._scene

    def views(self, split: Split) -> Views:
        """The views of a split, sorted by name."""
        return self._views[split]

    def notes(self) -> tuple[str, ...]:
        """How the data was read, what was left out, what is held out."""
        return self._notes

    def prefetch(self, split: Split, indices: Sequence[int]) -> None:
        """Start decoding views in threads, and sending them to a GPU."""
        self._loader.prefetch(split, indices)

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Decode views into batches; the same pictures whatever was cached or decoded ahead."""
        return self._loader.load(split, indices, device)

    def moving_mask(self, split: Split, index: int) -> Bool[Tensor, "h w 1"] | None:
        """The view's mask of what moves, if the data set has one."""
        number = self._members[split][index]
        frame = self._frames[number]
        if frame.moving is None:
            return None
        still = ~load_mask(frame.moving, frame.path, frame.header)
        # Where any of the pixels beneath moves, their mean does.
        return torch.from_numpy(~shrink_mask(still, *self._sizes[number]))[..., None]

    def close(self) -> None:
        """Stop decoding and free the pictures."""
        self._loader.close()

    def _decode(self, index: int) -> Picture:
        frame = self._frames[index]
        return load_picture(frame.path, frame.header, *self._sizes[index], mask=frame.mask)

    def _bytes(self, index: int) -> int:
        frame, (width, height) = self._frames[index], self._sizes[index]
        return width * height * (3 + frame.header.has_alpha + (frame.mask is not None))
