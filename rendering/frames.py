"""Frames: every frame of a film, or every view of a split, rendered and written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from torch import Tensor

from gsfw.core.cameras import Cameras
from gsfw.core.context import ViewContext
from gsfw.core.datamanager import Split, spread
from gsfw.core.loop.evaluation import own_images, render_model
from gsfw.core.maths.camera_path import gathered, up_direction, viewing_center
from gsfw.rendering.channels import CHANNELS, Channel, render_channels
from gsfw.rendering.frame_folder import FrameFolder, cameras_digest, model_digest
from gsfw.rendering.image_files import SUFFIXES, ImageFormat, write_image, write_values
from gsfw.rendering.panorama import panorama_images, panorama_width
from gsfw.rendering.pictures import SAMPLES, PictureStyle, picture
from gsfw.rendering.shot import Shot
from gsfw.rendering.stereo import eye_distance, stereo_images

if TYPE_CHECKING:
    from gsfw.plugins.compose import Composition
    from gsfw.rendering.frame_folder import Scales
    from gsfw.rendering.paths import RenderPath
    from gsfw.rendering.trails import Trails

Projection = Literal["camera", "stereo", "panorama"]


@dataclass(frozen=True)
class FrameRule:
    """The user's choices for every frame."""

    style: PictureStyle
    images: ImageFormat = "png"
    """Format of the files; an EXR has the values of the channels instead of a picture."""
    projection: Projection = "camera"
    """One image, those of two eyes side by side, or all directions."""
    eye_distance: float = 0.0
    """Distance of the eyes of stereo, in scene units; 0: by that of what is looked at."""
    width: int = 0
    """Width of panoramas, in pixels; 0: at the resolution of the cameras."""

    @property
    def suffix(self) -> str:
        """Suffix of the files."""
        return SUFFIXES[self.images]

    def request(self) -> dict[str, Any]:
        """The choices as plain data."""
        style = self.style
        return {
            "channels": [channel.name for channel in style.channels],
            "colormap": style.colormap,
            "range": style.ends,
            "bars": style.bars,
            "labels": style.labels,
            "images": self.images,
            "projection": self.projection,
            "eye_distance": self.eye_distance,
            "width": self.width,
        }


class FrameRenderer:
    """Renders and writes the frames of one run."""

    def __init__(self, composition: Composition, rule: FrameRule) -> None:
        self.composition, self.rule = composition, rule

    def request(self, cameras: Sequence[Cameras]) -> dict[str, Any]:
        """All that frames of these cameras depend on."""
        settings = self.composition.plan.settings
        background = settings.background
        return {
            **self.rule.request(),
            "model": self._model,
            "cameras": cameras_digest(cameras),
            "background": None if background is None else background.tolist(),
            "antialias": settings.antialias,
        }

    @cached_property
    def _model(self) -> str:
        return model_digest(self.composition.parts.model)

    def images(self, camera: Cameras) -> list[Tensor]:
        """The channels of a frame, in its projection."""
        if self.rule.projection == "stereo":
            distance = self.rule.eye_distance or eye_distance(camera, self._ring[0])
            return stereo_images(self._shoot, camera, distance)
        if self.rule.projection == "panorama":
            width = self.rule.width or panorama_width(camera)
            return panorama_images(
                self._shoot, self.rule.style.channels, camera, width, self._ring[1]
            )
        return self._shoot(camera)

    @cached_property
    def _ring(self) -> tuple[Tensor, Tensor]:
        """The point that the training cameras look at, and their upward direction; on the CPU."""
        views = self.composition.parts.data.views(Split.TRAIN).cameras
        cameras = gathered(views)
        return viewing_center(cameras), up_direction(cameras)

    def _shoot(self, camera: Cameras, channels: Sequence[Channel] | None = None) -> list[Tensor]:
        parts = self.composition.parts
        wanted = self.rule.style.channels if channels is None else channels
        camera = camera.to(parts.device)
        time = None if camera.time is None else camera.time[0]
        settings = self.composition.plan.settings
        return render_channels(wanted, Shot(parts.model, parts.rasterizer, camera, settings, time))

    def images_with_trails(self, camera: Cameras, trails: Trails, index: int) -> list[Tensor]:
        """The channels of a frame, the colours with the trails that lead to it."""
        channels = self.rule.style.channels
        *images, depth = self._shoot(camera, (*channels, CHANNELS["depth"]))
        moved = camera.to(images[0].device)
        return [
            trails.draw_on(image, depth.nan_to_num(0.0)[..., None], moved, index)
            if channel.name == "color"
            else image
            for channel, image in zip(channels, images, strict=True)
        ]

    def images_of_view(self, split: Split, index: int) -> tuple[list[Tensor], dict[str, Tensor]]:
        """The channels of a view of the data, and the images of its method, by name."""
        parts, settings = self.composition.parts, self.composition.plan.settings
        assert settings.background is not None
        (batch,) = parts.data.load(split, [index], parts.device)
        target = batch.target(settings.background)
        shot = Shot(
            parts.model,
            parts.rasterizer,
            batch.cameras,
            settings,
            batch.time,
            target[0],
            None if batch.valid is None else batch.valid[0],
        )
        images = render_channels(self.rule.style.channels, shot)
        output = render_model(parts.model, parts.rasterizer, batch.cameras, settings, batch.time)
        context = ViewContext(batch, output, target, parts.data.scene.extent)
        return images, dict(own_images(parts.method, context))

    def write(self, file: Path, images: Sequence[Tensor], scales: Scales) -> Path:
        """Write a frame."""
        if self.rule.images == "exr":
            return write_values(file, self.rule.style.channels, images)
        return write_image(file, picture(self.rule.style, images, scales), self.rule.images)


def film_frames(
    path: RenderPath,
    renderer: FrameRenderer,
    folder: Path,
    trails: Trails | None = None,
    drawn: Sequence[int] = (),
) -> tuple[FrameFolder, Iterator[Path]]:
    """Render and write the frames of a film, one at a time; those that are there are kept.

    Args:
        path: the cameras.
        renderer: how.
        folder: of the frames.
        trails: drawn on the colours; ``None`` for none.
        drawn: choices of the trails, which frames depend on.
    """
    cameras = [path.cameras.select([index]) for index in range(len(path.cameras))]
    request = {**renderer.request(cameras), "tracks": list(drawn) if trails else None}
    names = [f"{index:04d}{renderer.rule.suffix}" for index in range(len(cameras))]
    frames = FrameFolder(folder, request, names)

    def write_all() -> Iterator[Path]:
        scales = frames.scales
        if scales is None:
            sampled = spread(range(len(cameras)), SAMPLES)
            scales = renderer.rule.style.scales(renderer.images(cameras[n]) for n in sampled)
        frames.start(scales)
        for index, (camera, name) in enumerate(zip(cameras, names, strict=True)):
            if not frames.has(name):
                images = (
                    renderer.images(camera)
                    if trails is None
                    else renderer.images_with_trails(camera, trails, index)
                )
                renderer.write(folder / name, images, scales)
            yield folder / name

    return frames, write_all()


def view_frames(
    split: Split, renderer: FrameRenderer, folder: Path
) -> tuple[FrameFolder, Iterator[Path]]:
    """Render and write the views of a split, one at a time; those that are there are kept.

    The method's own images are files beside each.
    """
    views = renderer.composition.parts.data.views(split)
    # Numbered and flat: names of the data may be absolute, lead elsewhere, or be equal.
    stems = [f"{index:04d}_{Path(name).stem}" for index, name in enumerate(views.names)]
    names = [f"{stem}{renderer.rule.suffix}" for stem in stems]
    request = {**renderer.request(views.cameras), "split": split.value}
    frames = FrameFolder(folder, request, names)

    def write_all() -> Iterator[Path]:
        scales = frames.scales
        if scales is None:
            sampled = spread(range(len(names)), SAMPLES)
            scales = renderer.rule.style.scales(
                renderer.images_of_view(split, index)[0] for index in sampled
            )
        frames.start(scales)
        for index, (stem, name) in enumerate(zip(stems, names, strict=True)):
            if not frames.has(name):
                images, others = renderer.images_of_view(split, index)
                for kind, image in others.items():
                    yield write_image(folder / f"{stem}_{kind}.png", image)
                renderer.write(folder / name, images, scales)
            yield folder / name

    return frames, write_all()
