"""Capture: the data manager over the frames of a file, whatever its format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from statistics import median

import numpy as np
import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from gsfw.core.batch import Batch
from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import DataManager, DataRequest, Split, Views
from gsfw.core.errors import DataError
from gsfw.core.files.mirror import notes_on
from gsfw.core.loop.area import shrink_batch
from gsfw.core.maths.similarity import Similarity
from gsfw.core.scene import Scene
from gsfw.datamanagers.area import shrink_mask
from gsfw.datamanagers.color_profile import color_notes
from gsfw.datamanagers.fitted_map import ImageFit
from gsfw.datamanagers.frames import USUAL, Recording
from gsfw.datamanagers.holdout import hold_out
from gsfw.datamanagers.image_cache import ImageCache
from gsfw.datamanagers.images import (
    DecodedImage,
    decode,
    fit_image,
    fit_mask,
    fit_small,
    load_mask,
)
from gsfw.datamanagers.loader import Loader
from gsfw.datamanagers.masks import USUAL_MASKS, MaskRule, find_masks
from gsfw.datamanagers.scene_frame import scene_frame
from gsfw.datamanagers.timeline import Timeline
from gsfw.datamanagers.undistortion import LensRule, undistortion_notes
from gsfw.datamanagers.video_images import VideoImages
from gsfw.datamanagers.view_maps import MapFolder, ViewMaps
from gsfw.datamanagers.warp import MapCache, Warp

OVERSIZE = 3
"""Sides of a JPEG that decodes at a reduced size, at least, over those it is then shrunk to: with 2
the sharpness of fox and plush comes out at 0.82 of the true one, with 1.5 at 0.7."""
SMALL_LENS = 4_000_000
"""Pixels up to which images of lenses are undistorted exactly: more would take a gigabyte."""


class Capture(DataManager):
    """The frames of a recording in the scene frame, with their images decoded as needed.

    ``CaptureConfig.build`` makes it; formats write ``CaptureConfig.recording`` only.
    """

    def __init__(
        self,
        recording: Recording,
        request: DataRequest,
        rule: LensRule = USUAL,
        masks: MaskRule = USUAL_MASKS,
        maps: Sequence[MapFolder] = (),
        as_stored: bool = False,
    ) -> None:
        """Fit the cameras to their images, hold frames out, find the scene frame.

        Args:
            recording: what the format's file says.
            request: what the run asks for.
            rule: what becomes of images of distorted lenses.
            masks: which there are, and what they mean.
            maps: folders of per-view maps, besides those that the frames have.
            as_stored: take the numbers of files for sRGB, whatever they say.

        Raises:
            DataError: an image contradicts its camera, a lens cannot be undistorted, some frames
                have a time and some do not, a name is not unique, masks or maps cannot be used, or
                nothing is left to train on.
        """
        for folder in maps:
            recording = folder.add_to(recording)
        self.recording, self._rule, self._masks = recording, rule, masks
        self._as_stored = as_stored
        frames = sorted(recording.frames, key=lambda frame: frame.name)
        self._frames, self._mask_notes = find_masks(recording, frames, masks)
        self._maps = ViewMaps(recording, self._frames)
        self._held_out = hold_out(self._frames, request, recording)
        self._members = _members(self._held_out.splits)
        self._check_members(recording)
        timeline = Timeline.of(self._frames, recording.unused_times)
        train = self._members[Split.TRAIN]
        poses = torch.stack([frame.world_to_camera for frame in self._frames])
        held_out = poses[self._members[Split.EVAL]]
        scene_from_world, extent = scene_frame(poses[train], recording.points, held_out)
        cameras = [
            self._camera(i, request.downscale, scene_from_world, timeline)
            for i in range(len(self._frames))
        ]
        trained = [cameras[i] for i in train]
        self._scene = self._make_scene(recording, trained, scene_from_world, extent, timeline)
        self._views = self._make_views(cameras, self._held_out.how)
        self._fits = self._make_fits(cameras)
        self._videos = self._make_videos()
        self._loader = self._make_loader(request)

    def _make_scene(
        self,
        recording: Recording,
        trained: Sequence[Cameras],
        scene_from_world: Similarity,
        extent: float,
        timeline: Timeline,
    ) -> Scene:
        return Scene(
            name=recording.name,
            points=scene_from_world.apply(recording.points).float(),
            point_colors=recording.point_colors.float(),
            point_times=timeline.all_at(recording.point_times),
            camera_centers=torch.cat([camera.centers for camera in trained]),
            camera_axes=torch.cat([camera.world_to_camera[:, 2, :3] for camera in trained]),
            extent=extent,
            world_from_scene=scene_from_world.inverse(),
            time_range=timeline.range,
            num_times=timeline.count,
            up=recording.up,
            has_alpha=any(map(self._masks.gives_alpha, self._frames)),
            view_pixels=int(median(camera.width * camera.height for camera in trained)),
        )

    def _make_views(self, cameras: Sequence[Cameras], how: str) -> dict[Split, Views]:
        return {
            split: Views(
                names=tuple(self._frames[i].name for i in members),
                cameras=tuple(cameras[i] for i in members),
                origin=how,
                maps=self._maps.channels,
            )
            for split, members in self._members.items()
        }

    def _make_fits(self, cameras: Sequence[Cameras]) -> list[ImageFit]:
        """Undistortion and size of each image."""
        maps, fits = MapCache(), []
        for frame, camera in zip(self._frames, cameras, strict=True):
            undistortion = frame.undistortion(self._rule)
            warp = None if undistortion is None else Warp(undistortion, maps)
            stored = (frame.header.width, frame.header.height)
            fits.append(ImageFit(stored, (camera.width, camera.height), warp))
        return fits

    def _make_videos(self) -> VideoImages:
        shots = {i: frame.shot for i, frame in enumerate(self._frames) if frame.shot is not None}
        if self._as_stored:
            shots = {index: shot.as_stored() for index, shot in shots.items()}
        sizes = {index: self._image_bytes(index) for index in shots}
        return VideoImages(shots, sizes, self._fit)

    def _make_loader(self, request: DataRequest) -> Loader:
        order = [*self._members[Split.TRAIN], *self._members[Split.EVAL]]
        cache = ImageCache(
            lambda number: self._decode(order[number]),
            [self._image_bytes(i) + self._maps.bytes(i, self._fits[i]) for i in order],
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
        camera = frame.camera_at(downscale, self._rule)
        time = timeline.at(frame.time)
        return replace(
            camera,
            world_to_camera=scene_from_world.camera(camera.world_to_camera),
            time=None if time is None else torch.tensor([time], dtype=torch.float64),
            camera_index=torch.tensor([frame.camera]),
        ).to(dtype=torch.float32)

    @property
    def scene(self) -> Scene:
        """The scene of the capture before training."""
        return self._scene

    def views(self, split: Split) -> Views:
        """The views of a split, sorted by name."""
        return self._views[split]

    def notes(self) -> tuple[str, ...]:
        """Notes on the reading, the parts left out, and the held-out images."""
        how = self._views[Split.TRAIN].origin
        shown = ((frame.name, frame.header.unconverted) for frame in self._frames)
        undistortions = [frame.undistortion(self._rule) for frame in self._frames]
        return (
            *notes_on(self.recording.path),
            *self.recording.notes,
            *undistortion_notes([one for one in undistortions if one is not None]),
            *self._mask_notes,
            *(() if self._as_stored else color_notes(shown)),
            *self._maps.notes(),
            f"held-out views: {how if self._members[Split.EVAL] else f'none ({how})'}",
            *self._held_out.notes,
            *self._videos.notes(),
            *self._loader.notes(),
        )

    @property
    def mask_rule(self) -> MaskRule:
        """The masks that were looked for, and their meaning."""
        return self._masks

    def prefetch(self, split: Split, indices: Sequence[int]) -> None:
        """Start decoding views in threads, and sending them to a GPU."""
        self._loader.prefetch(split, indices)

    def load(self, split: Split, indices: Sequence[int], device: torch.device) -> list[Batch]:
        """Decode views into batches; the same images whatever was cached or decoded ahead."""
        return self._loader.load(split, indices, device)

    def load_small(self, split: Split, index: int, width: int, height: int) -> Batch:
        """A view on the CPU at a smaller size, decoded for this use and kept nowhere.

        Its maps are left out. For looking at, not for training: very large JPEGs decode at a
        reduced size, and large images of lenses are undistorted by linear interpolation.

        Raises:
            DataError: it does not decode.
        """
        number = self._members[split][index]
        frame, fit = self._frames[number], self._fits[number]
        small_lens = fit.warp is not None and fit.stored[0] * fit.stored[1] <= SMALL_LENS
        if frame.shot is not None or small_lens:
            (batch,) = self.load(split, [index], torch.device("cpu"))
            return shrink_batch(batch, width, height)
        least = (OVERSIZE * width, OVERSIZE * height)
        pixels = decode(frame.path, frame.header, least, self._as_stored)
        inside = self._masks.load(frame)
        if inside is not None:
            inside = shrink_mask(inside, pixels.shape[1], pixels.shape[0])
        pixels, valid = self._masks.apply(pixels, inside)
        values, mask = fit_small(pixels, valid, width, height, fit.warp)
        colors = torch.from_numpy(values)[None] / 255
        alpha = colors[..., 3:] if colors.shape[3] == 4 else None
        straight = colors[..., :3]
        return Batch(
            images=straight if alpha is None else straight / torch.where(alpha > 0, alpha, 1.0),
            cameras=self._views[split].cameras[index].resized(width, height),
            views=(index,),
            alpha=alpha,
            mask=None if mask is None else torch.from_numpy(mask)[None, ..., None],
        )

    def moving_mask(self, split: Split, index: int) -> Bool[Tensor, "h w 1"] | None:
        """The view's mask of moving pixels, if the data set has one."""
        number = self._members[split][index]
        frame = self._frames[number]
        if frame.moving is None:
            return None
        still = ~load_mask(frame.moving, frame.path, frame.header)
        fit = self._fits[number]
        # If any of the source pixels moves, their mean does.
        fitted = fit_mask(still, *fit.final, fit.warp)
        assert fitted is not None
        return torch.from_numpy(~fitted)[..., None]

    def drop_images(self) -> int:
        """Keep half as many decoded images from now on; returns the bytes that are free now."""
        return self._loader.drop_images()

    def close(self) -> None:
        """Stop decoding and free the images."""
        self._loader.close()
        self._videos.close()

    def _decode(self, index: int) -> DecodedImage:
        """An image with its per-view maps."""
        frame = self._frames[index]
        if frame.shot is not None:
            image = self._videos.get(index)
        else:
            pixels = decode(frame.path, frame.header, as_stored=self._as_stored)
            image = self._fit(index, pixels)
        inside = self._masks.inside(frame, image)
        scale = self._scene.world_from_scene.inverse().scale
        return replace(image, maps=self._maps.load(index, self._fits[index], inside, scale))

    def _fit(self, index: int, pixels: UInt8[np.ndarray, "h w d"]) -> DecodedImage:
        """A decoded image, masked, undistorted and shrunk."""
        masks = self._masks
        pixels, valid = masks.apply(pixels, masks.load(self._frames[index]))
        fit = self._fits[index]
        return fit_image(pixels, valid, *fit.final, fit.warp)

    def _image_bytes(self, index: int) -> int:
        """Memory of a fitted image without its maps."""
        frame, fit = self._frames[index], self._fits[index]
        blanks = fit.warp is not None and fit.warp.undistortion.has_blanks
        masked = self._masks.gives_mask(frame) or blanks
        return fit.final[0] * fit.final[1] * (3 + self._masks.gives_alpha(frame) + masked)


def _members(splits: Sequence[Split]) -> dict[Split, list[int]]:
    """The numbers of the frames of each split."""
    return {split: [i for i, member in enumerate(splits) if member is split] for split in Split}
