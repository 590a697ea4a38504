"""Upright frames: images that EXIF turns, and cameras that describe them as they are stored.

COLMAP (src/colmap/sensor/bitmap.cc), OpenSfM (opensfm/io.py: "ignoring EXIF orientation"),
OpenMVG and Metashape reconstruct from pixels as stored, and programs that train from their files
read pixels in the same way. gsfw shows images upright, and turns such a camera with its image.
"""

from __future__ import annotations

from dataclasses import replace

import torch

from gsfw.datamanagers.frames import Frame
from gsfw.datamanagers.lens import COEFFICIENTS, Lens

QUARTER_TURNS = {6: 1, 3: 2, 8: 3}
"""Clockwise quarter turns that make an image of each EXIF orientation upright. The others mirror
images, and no camera writes them."""
QUARTER_TURN = torch.tensor([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]).double()
"""From the axes of a camera (x right, y down) to those of the camera whose image is turned."""
ACROSS_AND_DOWN = (("p2", "p1"), ("sx1", "sy1"))
"""Coefficients that move pixels across, each with that which moves them down by the same term."""
LONG_ACROSS_AND_DOWN = (("p0", "p1"), ("s0", "s2"), ("s1", "s3"))
"""The same of RAD_TAN_THIN_PRISM_FISHEYE, which has its own names."""


def upright(frame: Frame) -> Frame:
    """The frame with the camera of its upright image.

    A camera is taken to describe the stored image, unless its sides are those of the upright one.
    """
    turns = QUARTER_TURNS.get(frame.header.orientation, 0)
    lens, pose = frame.lens, frame.world_to_camera
    if not turns or (turns % 2 and _has_shape(lens, frame.header.width, frame.header.height)):
        return frame
    for _ in range(turns):
        lens, pose = _turned(lens), QUARTER_TURN @ pose
    return replace(frame, lens=lens, world_to_camera=pose)


def _has_shape(lens: Lens, width: int, height: int) -> bool:
    """True if the lens is wide where an image is, and high where it is high."""
    return (lens.width - lens.height) * (width - height) > 0


def _turned(lens: Lens) -> Lens:
    """The lens of the image turned clockwise by a quarter: x becomes -y, and y becomes x."""
    names = COEFFICIENTS.get(lens.model, ())
    old = dict(zip(names, lens.distortion, strict=False))
    new = dict(old)
    for across, down in LONG_ACROSS_AND_DOWN if "p0" in old else ACROSS_AND_DOWN:
        if across in old:
            new[across], new[down] = -old[down], old[across]
    return replace(
        lens,
        fx=lens.fy,
        fy=lens.fx,
        cx=lens.height - lens.cy,
        cy=lens.cx,
        width=lens.height,
        height=lens.width,
        distortion=tuple(new.values()),
    )
