"""Timed cameras: a written COLMAP model becomes a transforms.json, which holds times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import torch

from gsfw.core.files.atomic import readable_write_errors
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.masks import USUAL_MASKS, find_masks
from gsfw.datamanagers.transforms_writer import write_transforms
from gsfw.preparation.writing.written_files import remove_model

UPRIGHT = torch.tensor(
    [[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=torch.float64
)
"""Turns the world of a COLMAP model, whose -y is up, to that of a transforms.json: z is up."""


def model_to_transforms(out: Path, times: Mapping[str, float]) -> int:
    """Write the transforms.json of a data set in COLMAP's layout, and remove its model.

    Args:
        out: the data set.
        times: seconds by name of the image; empty if images have none.

    Returns:
        Bytes written.

    Raises:
        OutputError: a file cannot be written, or the model cannot be removed.
    """
    recording = ColmapConfig().recording(out, 1.0)
    frames, _ = find_masks(recording, recording.frames, USUAL_MASKS)
    turned = [
        replace(
            frame,
            time=times.get(frame.name),
            world_to_camera=frame.world_to_camera @ UPRIGHT.T,
        )
        for frame in frames
    ]
    points = recording.points @ UPRIGHT[:3, :3].T
    size = write_transforms(replace(recording, frames=tuple(turned), points=points), out)
    with readable_write_errors(out):
        remove_model(out)
    return size
