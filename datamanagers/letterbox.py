"""Letterbox: what a lens becomes in a video that was later scaled, or fitted into another shape."""

from __future__ import annotations

import numpy as np

from gsfw.core.errors import DataError
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.video import Box, Video

BLACK = 16.0
"""Mean brightness of a bar, at most: black is 0, and compression leaves a little around it."""


def fit_to_video(lens: Lens, video: Video) -> tuple[Lens, Video, str]:
    """The lens in pixels of the video, the video without black bars, and a note on what was done.

    Raises:
        DataError: the video's size is not that of the lens, and was not made from it by scaling,
            with or without black bars.
    """
    width, height = video.header.width, video.header.height
    if (width, height) == (lens.width, lens.height):
        return lens, video, ""
    scale = min(width / lens.width, height / lens.height)
    shown = round(lens.width * scale), round(lens.height * scale)
    if max(abs(shown[0] - width), abs(shown[1] - height)) <= 1:
        note = f"{video.path.name} is {width}x{height}, {lens.width}x{lens.height} scaled"
        return lens.resized(width, height), video, note
    left, top = (width - shown[0]) // 2, (height - shown[1]) // 2
    box = left, top, left + shown[0], top + shown[1]
    if not _has_bars(video, box):
        advice = "Give the video that the camera was calibrated with, or calibrate with this one."
        if (height, width) == (lens.width, lens.height):
            advice = "They differ by a quarter turn; turn the video or the calibration. " + advice
        raise DataError(
            f"{video.path} is {video.header}, but {lens.source} describes "
            f"{lens.width}x{lens.height}, which is another shape, and there are no black bars.",
            advice,
        )
    note = (
        f"{video.path.name} is {width}x{height}, {lens.width}x{lens.height} scaled to "
        f"{shown[0]}x{shown[1]} between black bars, which are cut off"
    )
    return lens.resized(*shown), video.cropped(box), note


def _has_bars(video: Video, box: Box) -> bool:
    """Whether the first picture is black outside ``box``, and not all black within."""
    left, top, right, bottom = box
    brightness = video.picture(0).mean(axis=2)
    within = float(brightness[top:bottom, left:right].mean())
    bars = (
        brightness[:top],
        brightness[bottom:],
        brightness[top:bottom, :left],
        brightness[top:bottom, right:],
    )
    return within > BLACK and all(float(np.mean(bar)) <= BLACK for bar in bars if bar.size)
