"""Images of TensorBoard: ground truth, render and error side by side, with a caption."""

from __future__ import annotations

import io

import numpy as np
import torch
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont
from tensorboard.compat.proto.summary_pb2 import Summary
from torch import Tensor

from gsfw.core.callback import EvaluatedView, TrainingView
from gsfw.core.color_bytes import color_bytes

ERROR_WHITE = 0.25
"""Mean absolute error of the channels from which on the error is white."""
LONGEST, SHORTEST = 480, 280
"""Width of an image in pixels: larger ones are shrunk, so that three fit on a screen; small ones
are enlarged by whole numbers."""
MARGIN, GAP = 10, 6
TITLE, LABEL = 36, 46
"""Widths of the whole over the sizes of type: TensorBoard shows it at about 350 pixels first."""
LEAST_TYPE = 12.0
"""Smallest type, in pixels."""
QUALITY = 90
"""Quality of JPEG; colours have the resolution of the image, so that text stays sharp."""
PAPER, INK, FAINT = "#ffffff", "#3c3c40", "#78787e"
"""Colours of the house style (``charts.style``)."""

LEFT_OUT = (0.9, 0.1, 0.1)
"""Colour of distractors."""

LABELS = ("ground truth", "render", f"error (white: {ERROR_WHITE:g})")


def comparison(
    view: EvaluatedView, step: int, steps: int
) -> UInt8[np.ndarray, "sheet_h sheet_w 3"]:
    """Ground truth, render and error of a view, under a line with name, PSNR and step."""
    panels = [view.target, view.rendered, error_image(view.target, view.rendered)]
    psnr = view.metrics.get("psnr")
    figure = "" if psnr is None else f"PSNR {psnr:.2f} dB, "
    return captioned(panels, LABELS, view.name, f"{figure}step {step:,} of {steps:,}")


def distractors(
    view: TrainingView, step: int, steps: int
) -> UInt8[np.ndarray, "sheet_h sheet_w 3"]:
    """A training image with its distractors in one colour, and its render."""
    assert view.left_out is not None
    marked = torch.where(view.left_out, view.target.new_tensor(LEFT_OUT), view.target)
    share = f"{float(view.left_out.float().mean()):.0%} left out, step {step:,} of {steps:,}"
    return captioned([marked, view.rendered], ("image, red: left out", "render"), view.name, share)


def error_image(
    target: Float[Tensor, "h w 3"], rendered: Float[Tensor, "h w 3"]
) -> Float[Tensor, "h w 3"]:
    """Mean absolute error of the channels as a grey image."""
    error = (rendered.clamp(0, 1) - target.clamp(0, 1)).abs().mean(-1, keepdim=True) / ERROR_WHITE
    return error.clamp(0, 1).expand(-1, -1, 3)


def captioned(
    panels: list[Float[Tensor, "h w 3"]], labels: tuple[str, ...], title: str, remark: str
) -> UInt8[np.ndarray, "sheet_h sheet_w 3"]:
    """Images of one size in a row, each with a label, below a title.

    Args:
        panels: images in [0, 1].
        labels: one for each image; empty for none.
        title: name of the view.
        remark: follows the title in grey.
    """
    images = [_sized(panel) for panel in panels]
    width, height = images[0].size
    whole = 2 * MARGIN + len(images) * width + (len(images) - 1) * GAP
    large, small = (max(whole / part, LEAST_TYPE) for part in (TITLE, LABEL))
    font, label_font = ImageFont.load_default(large), ImageFont.load_default(small)
    labels_at = MARGIN + round(1.5 * large)
    top = labels_at + (round(1.4 * small) if any(labels) else 0)
    sheet = Image.new("RGB", (whole, top + height + MARGIN), PAPER)
    draw = ImageDraw.Draw(sheet)
    draw.text((MARGIN, MARGIN), title, INK, font)
    after = MARGIN + draw.textlength(f"{title}   ", font)
    draw.text((after, MARGIN), remark, FAINT, font)
    for place, (image, label) in enumerate(zip(images, labels, strict=True)):
        x = MARGIN + place * (width + GAP)
        draw.text((x, labels_at), label, FAINT, label_font)
        sheet.paste(image, (x, top))
    return np.asarray(sheet)


def summary_of(tag: str, image: UInt8[np.ndarray, "h w 3"]) -> Summary:
    """An image as TensorBoard stores it, as JPEG: events are written at a megabyte per second."""
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=QUALITY, subsampling=0)
    height, width, channels = image.shape
    shown = Summary.Image(
        height=height, width=width, colorspace=channels, encoded_image_string=buffer.getvalue()
    )
    return Summary(value=[Summary.Value(tag=tag, image=shown)])


def _sized(panel: Float[Tensor, "h w 3"]) -> Image.Image:
    """An image at a width that can be looked at."""
    image = Image.fromarray(color_bytes(panel).cpu().numpy())
    width, height = image.size
    if width > LONGEST:
        size = (LONGEST, max(1, round(height * LONGEST / width)))
        return image.resize(size, Image.Resampling.BOX)
    factor = -(-SHORTEST // width)
    return image.resize((width * factor, height * factor), Image.Resampling.NEAREST)
