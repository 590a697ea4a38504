"""Frame: the image of a page's state, rendered by the rasterizer of the run."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor
from torch.nn.functional import interpolate

from gsfw.core.cameras import Cameras
from gsfw.core.color_bytes import color_bytes
from gsfw.core.metrics import is_hidden, psnr
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.rendering.channels import CHANNELS, Channel, render_channels
from gsfw.rendering.color_maps import colored, value_range
from gsfw.rendering.pictures import PictureStyle
from gsfw.rendering.shot import Shot
from gsfw.rendering.trails import Trails, make_trails
from gsfw.viewer.arrangement import below, beside, best_columns, centred, fitted, slots, wiped
from gsfw.viewer.shown_model import shown
from gsfw.viewer.view_state import CapturedView, Comparison, ViewState
from gsfw.viewer.viewed_model import ViewedModel, between

TRACKS, TRACK_TIMES, TRACK_LENGTH = 150, 49, 8
"""Number of paths, number of times at which they are known, and how many each reaches back."""
TRACK_SIZE = (480, 270)
"""Size of the images in which Gaussians on surfaces are found, to follow."""

Size = tuple[int, int]
MakeImage = Callable[[Size], Tensor]
"""Makes [h, w, 3] in [0, 1] of a size (width, height) at most; in its own shape."""


@dataclass(frozen=True)
class ValueScale:
    """Meaning of the colours of a channel of values."""

    low: float
    high: float
    unit: str
    colormap: str


def has_values(state: ViewState) -> bool:
    """True if the page shows values in colours, without a photo."""
    channel = CHANNELS[state.channel]
    return channel.kind == "scalar" and not channel.needs_image


def value_scale(state: ViewState, samples: Sequence[Tensor]) -> ValueScale:
    """One scale for all frames of a film, of the values of some of them."""
    channel = CHANNELS[state.channel]
    scales = PictureStyle((channel,)).scales([sample] for sample in samples)
    return ValueScale(*scales[channel.name], channel.unit, channel.colormap)


@dataclass(frozen=True)
class Frame:
    """The image of a page's state."""

    image: UInt8[np.ndarray, "h w 3"]
    seconds: float
    """Time to render it."""
    scale: ValueScale | None = None
    """Meaning of its colours; ``None`` where they are those of the scene."""
    psnr: float | None = None
    """PSNR of the render against the photo, in dB; ``None`` without a photo."""
    psnr_size: Size = (0, 0)
    """Width and height that it was measured at: those of the photo, unless the page is smaller."""


@dataclass(frozen=True)
class Photo:
    """The photo of a captured view."""

    color: Float[Tensor, "h w 3"]
    """Over the background."""
    valid: Bool[Tensor, "h w 1"] | None
    """True where it is compared; ``None`` for everywhere."""

    def fitted(self, size: Size) -> Photo:
        """The photo at the largest size that fits, but no larger than it is."""
        height, width = self.color.shape[:2]
        inner = compared_size(width, height, size)
        valid = self.valid
        if valid is not None and inner != (width, height):
            valid = resized(valid.float().expand(-1, -1, 3), inner)[..., :1] > 0.5
        return Photo(resized(self.color, inner), valid)


class FrameMaker:
    """Renders the states of pages; must be used by the thread that owns the models."""

    def __init__(self, models: Sequence[ViewedModel]) -> None:
        """Show these models, one or two to compare."""
        self._models = tuple(models)
        self.trails: dict[str, Trails] = {}
        """Paths of Gaussians by model, over ``TRACK_TIMES`` times; none before a page wants any."""
        self._photo: tuple[CapturedView, Photo] | None = None

    @torch.no_grad()
    def make(self, state: ViewState, scale: float = 1.0, values: ValueScale | None = None) -> Frame:
        """The frame of a state.

        Args:
            state: content of the frame.
            scale: side of the frame, relative to that at rest.
            values: meaning of the colours of its values; ``None``: found in the frame.

        Raises:
            UserError: the channel cannot be rendered, or a photo does not decode.
        """
        started = time.perf_counter()
        full = state.full_size()
        size = (max(round(full[0] * scale), 1), max(round(full[1] * scale), 1))
        shot = _Shot(self._models, state, self._photo_of, self.trails, values)
        image = shot.image(size)
        pixels = color_bytes(image).cpu().numpy()
        return Frame(pixels, time.perf_counter() - started, shot.scale, shot.psnr, shot.psnr_size)

    @torch.no_grad()
    def values(self, state: ViewState) -> Float[Tensor, " n"]:
        """The values of the channel of a state, of all models, as they are."""
        shot = _Shot(self._models, state, self._photo_of, {}, None)
        channel, size = CHANNELS[state.channel], state.full_size()
        return torch.cat([shot.values(model, channel, size).flatten() for model in self._models])

    @torch.no_grad()
    def make_trails(self, state: ViewState) -> None:
        """Follow some Gaussians of each moving model, of those that a page sees."""
        for model in self._models:
            if model.is_dynamic:
                shot = _Shot(self._models, state, self._photo_of, {}, None)
                self.trails[model.name] = shot.trails_of(model)

    def _photo_of(self, view: CapturedView) -> Photo:
        """The photo of a view, over the background; the last one is kept."""
        if self._photo is None or self._photo[0] != view:
            model = self._models[0]
            background = model.settings.background
            assert background is not None
            batch = model.batch(view)
            valid = None if batch.valid is None else batch.valid[0]
            self._photo = (view, Photo(batch.target(background)[0], valid))
        return self._photo[1]


class _Shot:
    """The images of one state, and how they are arranged."""

    def __init__(
        self,
        models: Sequence[ViewedModel],
        state: ViewState,
        photo_of: Callable[[CapturedView], Photo],
        trails: Mapping[str, Trails],
        scale: ValueScale | None,
    ) -> None:
        self._models, self._state, self._photo_of = models, state, photo_of
        self._trails, self.scale = trails, scale
        self.psnr: float | None = None
        self.psnr_size = (0, 0)

    def image(self, size: Size) -> Float[Tensor, "h w 3"]:
        """The arranged images, of this size exactly."""
        makers, behind = self._makers(), self._state.behind
        if self._state.comparison is Comparison.WIPE and len(makers) > 1:
            first, second = (centred(make(size), size, behind) for make in makers[:2])
            return wiped(first, second, self._state.wipe)
        columns = self._columns(len(makers), size)
        rows = [makers[first : first + columns] for first in range(0, len(makers), columns)]
        heights = [height for height, _ in slots(size[1], 1, len(rows))]
        images = []
        for row, height in zip(rows, heights, strict=True):
            places = slots(size[0], height, columns)[: len(row)]
            parts = [
                centred(make(slot), slot, behind) for make, slot in zip(row, places, strict=True)
            ]
            images.append(centred(beside(parts, behind), (size[0], height), behind))
        return below(images, behind)

    def _columns(self, count: int, size: Size) -> int:
        """Images of one view have its shape; those of a free page take the shape of their place."""
        if self._state.view is None:
            return count
        camera = self._models[0].camera(self._state.view)
        return best_columns(count, size, camera.width / camera.height)

    def _makers(self) -> list[MakeImage]:
        """Makers of the images of the comparison, from left to right."""
        renders: list[MakeImage] = [self._render_of(model) for model in self._models]
        view, comparison = self._state.view, self._state.comparison
        photos: list[MakeImage] = (
            [self._photo] if view is not None and self._models[0].has_photos else []
        )
        single = len(self._models) == 1
        if comparison is Comparison.OTHER:
            return photos or renders[-1:]
        if comparison is Comparison.WIPE:
            return [*photos, *renders] if single else renders
        if comparison is Comparison.SIDE_BY_SIDE:
            return [*photos, *renders, *([self._error] if photos and single else [])]
        return renders[:1]

    def _render_of(self, model: ViewedModel) -> MakeImage:
        def make(size: Size) -> Tensor:
            channel = CHANNELS[self._state.channel]
            if channel.needs_image and not self._has_photo:
                channel = CHANNELS["color"]
            return self._render(model, channel, size)

        return make

    @property
    def _has_photo(self) -> bool:
        return self._state.view is not None and self._models[0].has_photos

    def _photo(self, size: Size) -> Float[Tensor, "h w 3"]:
        assert self._state.view is not None
        photo = self._photo_of(self._state.view).color
        return resized(photo, fitted(photo.shape[1], photo.shape[0], size))

    def _error(self, size: Size) -> Float[Tensor, "h w 3"]:
        """The error of the render, in colours of its own scale."""
        kept = self.scale
        image = self._render(self._models[0], CHANNELS["error"], size)
        self.scale = kept or self.scale
        return image

    def _render(self, model: ViewedModel, channel: Channel, size: Size) -> Float[Tensor, "h w 3"]:
        """One channel of a model, in colours; of a view at the size of its photo at most."""
        state = self._state
        trails = self._trails.get(model.name) if state.tracks and channel.name == "color" else None
        wanted = (channel,) if trails is None else (channel, CHANNELS["depth"])
        camera = self._camera(model, size)
        values, *depth = self._channels(model, wanted, camera, size)
        if self._has_photo and channel.name == "color" and self.psnr is None:
            photo = self._photo_fitted(size)
            if not is_hidden(photo.valid):
                self.psnr = psnr(values, photo.color, photo.valid)
                self.psnr_size = (camera.width, camera.height)
        if trails is not None:
            surface = depth[0].nan_to_num(0.0)[..., None]
            moment = state.time * (TRACK_TIMES - 1)
            values = trails.draw_on(values, surface, camera, moment).to(model.device)
        image = values if channel.kind == "color" else self._colored(channel, values)
        return image if state.view is None else resized(image, fitted(*_size(image), size))

    def values(self, model: ViewedModel, channel: Channel, size: Size) -> Tensor:
        """A channel of a model as it is, in the units of the first one."""
        return self._channels(model, (channel,), self._camera(model, size), size)[0]

    def _channels(
        self, model: ViewedModel, channels: Sequence[Channel], camera: Cameras, size: Size
    ) -> list[Tensor]:
        state, first = self._state, self._models[0]
        compared = self._has_photo and channels[0].needs_image
        photo = self._photo_fitted(size) if compared else None
        shot = Shot(
            shown(model.model, state, None if model is first else between(model, first)),
            model.rasterizer,
            camera,
            self._settings(model),
            torch.tensor(state.time, device=model.device) if model.is_dynamic else None,
            None if photo is None else photo.color,
            None if photo is None else photo.valid,
        )
        rendered = render_channels(channels, shot)
        # Each run has scene units of its own.
        unit = 1.0 if model is first else between(model, first).scale
        lengths = [channel.unit.startswith("scene units") for channel in channels]
        return [
            item * unit if length else item for item, length in zip(rendered, lengths, strict=True)
        ]

    def _photo_fitted(self, size: Size) -> Photo:
        assert self._state.view is not None
        return self._photo_of(self._state.view).fitted(size)

    def trails_of(self, model: ViewedModel) -> Trails:
        """The paths of Gaussians that the page sees, over all times."""
        camera = self._camera(model, TRACK_SIZE)
        times = torch.linspace(0, 1, TRACK_TIMES, device=model.device)
        many = replace(
            camera,
            world_to_camera=camera.world_to_camera.expand(TRACK_TIMES, 4, 4),
            intrinsics=camera.intrinsics.expand(TRACK_TIMES, 3, 3),
            time=times,
        )
        settings = self._settings(model)
        return make_trails(model.model, model.rasterizer, many, settings, TRACKS, TRACK_LENGTH)

    def _colored(self, channel: Channel, values: Tensor) -> Float[Tensor, "h w 3"]:
        if self.scale is not None and channel.name == self._state.channel:
            low, high = self.scale.low, self.scale.high  # Two runs, or all frames, share one.
        else:
            low, high = value_range(values, channel.low, channel.high)
        self.scale = ValueScale(low, high, channel.unit, channel.colormap)
        return colored(values, low, high, channel.colormap)

    def _camera(self, model: ViewedModel, size: Size) -> Cameras:
        """The camera of the state for a model, on its device."""
        state, first = self._state, self._models[0]
        moment = state.time if model.is_dynamic else None
        if state.view is not None:
            camera = first.camera(state.view)
            camera = camera.resized(*compared_size(camera.width, camera.height, size))
            time = None if moment is None else torch.tensor([moment])
            camera = replace(camera.to("cpu"), time=time)
        else:
            camera = state.pose.cameras(*size, moment)
        if model is not first:  # Each run has a scene frame of its own.
            placed = between(first, model).camera(camera.world_to_camera)
            camera = replace(camera, world_to_camera=placed.float())
        return camera.to(model.device)

    def _settings(self, model: ViewedModel) -> RenderSettings:
        settings = replace(model.settings, validation=Validation.CHEAP)
        color = self._state.background
        if color is None:
            return settings
        return replace(settings, background=torch.tensor(color, device=model.device))


def compared_size(width: int, height: int, size: Size) -> Size:
    """Size at which a photo and its render are compared: the photo's own, where it fits."""
    inner = fitted(width, height, size)
    return inner if inner[0] < width else (width, height)


def _size(image: Tensor) -> Size:
    return image.shape[1], image.shape[0]


def resized(image: Float[Tensor, "h w 3"], size: Size) -> Float[Tensor, "h2 w2 3"]:
    """An image at another size (width, height): pixel areas where it shrinks, else bilinear."""
    height, width = image.shape[:2]
    if (width, height) == size:
        return image
    planes = image.movedim(-1, 0)[None]
    target = (size[1], size[0])
    if size[0] <= width and size[1] <= height:
        return interpolate(planes, size=target, mode="area")[0].movedim(0, -1)
    larger = interpolate(planes, size=target, mode="bilinear", align_corners=False)
    return larger[0].movedim(0, -1)
