"""Pictures: rendered channels side by side, values in colours, with colour bars and names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch

from gsfw.core.color_bytes import color_bytes
from gsfw.rendering.channels import Channel
from gsfw.rendering.color_maps import UNKNOWN, color_bar, colored, type_face, value_range

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from gsfw.rendering.frame_folder import Scales

LEAST_HEIGHT = 100
"""Pictures of fewer lines have neither bars nor names: there is no room."""

LINE, LINE_GREY = 2, 0.45
"""Width in pixels and grey of the line behind a colour bar: it belongs to the image before it."""

SAMPLES = 6
"""Frames of which the colour scale of a film is found; all of its frames share it."""


@dataclass(frozen=True)
class PictureStyle:
    """The look of every frame."""

    channels: tuple[Channel, ...]
    """Channels from left to right; none for the usual ones of what is rendered."""
    colormap: str = ""
    """Colour map of all values; empty: that of each channel."""
    ends: tuple[float, float] | None = None
    """Least and largest value of the colour scale; ``None``: found."""
    bars: bool = True
    """A colour bar at the right of each channel of values."""
    labels: bool = True
    """The name of each channel, where there are several."""

    def map_of(self, channel: Channel) -> str:
        """Name of the colour map of a channel."""
        return self.colormap or channel.colormap

    def scales(self, samples: Iterable[Sequence[Tensor]]) -> Scales:
        """The colour scales of the channels of values, which all frames share.

        Args:
            samples: channels of some frames.
        """
        wanted = [number for number, item in enumerate(self.channels) if item.kind == "scalar"]
        if self.ends is not None:
            return {self.channels[number].name: self.ends for number in wanted}
        if not wanted:
            return {}
        found: dict[int, list[Tensor]] = {number: [] for number in wanted}
        for images in samples:
            for number in wanted:
                found[number].append(images[number].flatten())
        return {
            self.channels[number].name: value_range(
                torch.cat(values), self.channels[number].low, self.channels[number].high
            )
            for number, values in found.items()
        }


def picture(
    style: PictureStyle, images: Sequence[Tensor], scales: Scales
) -> Float[Tensor, "h w 3"]:
    """The channels of one frame as one picture, on the CPU.

    Args:
        style: the look.
        images: a channel each, as ``render_channels`` returns them, of one size.
        scales: as ``PictureStyle.scales`` returns them.
    """
    panels: list[Tensor] = []
    has_bar = False
    for channel, rendered in zip(style.channels, images, strict=True):
        image = rendered.detach().cpu()
        height = image.shape[0]
        if has_bar:
            panels.append(torch.full((height, LINE, 3), LINE_GREY))
        roomy = height >= LEAST_HEIGHT
        if channel.kind == "color":
            panel = image.float().clamp(0, 1)
            if channel.name == "normals":
                panel = torch.where(panel.sum(2, keepdim=True) > 0, panel, UNKNOWN)
        else:
            low, high = scales[channel.name]
            panel = colored(image, low, high, style.map_of(channel))
        if style.labels and roomy and len(images) > 1:
            panel = _named(panel, channel.name.replace("_", " "))
        panels.append(panel)
        has_bar = channel.kind == "scalar" and style.bars and roomy
        if has_bar:
            panels.append(color_bar(height, low, high, channel.unit, style.map_of(channel)))
    return torch.cat(panels, dim=1)


def _named(panel: Float[Tensor, "h w 3"], name: str) -> Float[Tensor, "h w 3"]:
    """A panel with its name at the top left, on a shade that it can be read on."""
    import numpy as np
    from PIL import Image, ImageDraw

    size = max(min(panel.shape[0] // 22, 24), 9)
    face, margin = type_face(size), max(size // 2, 4)
    box = (margin, margin, margin + round(face.getlength(name)) + size, margin + round(1.7 * size))
    image = Image.fromarray(color_bytes(panel).numpy())
    shade = Image.new("L", image.size, 0)
    ImageDraw.Draw(shade).rounded_rectangle(box, radius=size // 3, fill=150)
    image.paste((16, 16, 20), mask=shade)
    middle = (margin + size / 2, (box[1] + box[3]) / 2)
    ImageDraw.Draw(image).text(middle, name, fill=(238, 238, 242), font=face, anchor="lm")
    return torch.from_numpy(np.asarray(image).copy()).float() / 255
