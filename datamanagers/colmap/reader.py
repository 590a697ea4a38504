"""Reads a COLMAP model, and checks that it is one that can be trained on."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gsfw.core.errors import DataError
from gsfw.datamanagers.colmap import binary, text
from gsfw.datamanagers.colmap.model import (
    ColmapCamera,
    ColmapImage,
    ColmapModel,
    damaged,
    model_suffix,
)
from gsfw.datamanagers.frames import Sightings
from gsfw.datamanagers.lens import COEFFICIENTS, ONE_FOCAL_LENGTH, Lens


def read_model(folder: Path) -> ColmapModel:
    """Read and check a model.

    Raises:
        DataError: a file is missing, cut off or damaged, or there are no images.
    """
    suffix = model_suffix(folder) or ".bin"
    cameras, images, points = (
        folder / f"{part}{suffix}" for part in ("cameras", "images", "points3D")
    )
    if not images.is_file():
        raise DataError(
            f"{folder} holds {cameras.name}, but there is no {images.name} beside it.",
            "Copy the whole model: cameras, images and points3D.",
        )
    reader = binary if suffix == ".bin" else text
    known, registered = reader.read_cameras(cameras), reader.read_images(images)
    if not registered:
        raise DataError(
            f"{images} contains no images: COLMAP has placed no camera.",
            "Look at COLMAP's log; it needs images that overlap and show texture.",
        )
    for image in registered:
        if image.camera not in known:
            raise damaged(
                images,
                f"{image.name} was taken by camera {image.camera}, "
                f"which {cameras.name} does not have",
            )
    if points.is_file():
        positions, colors = reader.read_points(points)
    else:
        positions, colors = np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    if not np.isfinite(positions).all():
        raise damaged(points, "some of its points are not finite")
    return ColmapModel(cameras, known, registered, positions, colors)


def read_sightings(folder: Path, images: Sequence[ColmapImage], names: Sequence[str]) -> Sightings:
    """Read which images show which points.

    Args:
        folder: of a model that ``read_model`` has read.
        images: of that model.
        names: of the images that are used, in their order.

    Raises:
        DataError: the file of the points is cut off or damaged.
    """
    suffix = model_suffix(folder) or ".bin"
    points = folder / f"points3D{suffix}"
    if not points.is_file():
        return Sightings.none()
    tracks = (binary if suffix == ".bin" else text).read_tracks(points)
    rows = {name: row for row, name in enumerate(names)}
    used = sorted((image.number, rows[image.name]) for image in images if image.name in rows)
    numbers, frames = np.array(used, np.int64).reshape(-1, 2).T
    points_of = np.repeat(np.arange(len(tracks.lengths)), tracks.lengths)
    known = np.isin(tracks.images, numbers)
    frames_of = frames[np.searchsorted(numbers, tracks.images[known])]
    # A track may name an image twice.
    pairs = np.unique(points_of[known] * max(len(names), 1) + frames_of)
    return Sightings(*np.divmod(pairs, max(len(names), 1)), tracks.errors)


def lens_of(camera: ColmapCamera, number: int, file: Path) -> Lens:
    """The camera as a lens.

    Raises:
        DataError: its model is none of a lens, or its numbers are not those of a camera.
    """
    source = f"camera {number} of {file}"
    focals = 1 if camera.model in ONE_FOCAL_LENGTH else 2
    values = camera.parameters
    if camera.model not in COEFFICIENTS:
        raise DataError(
            f"{source}: images of the model {camera.model} cannot be trained on.",
            "Cut them into images of pinhole cameras first: a panorama has no image plane.",
        )
    lens = Lens(
        fx=values[0],
        fy=values[focals - 1],
        cx=values[focals],
        cy=values[focals + 1],
        width=camera.width,
        height=camera.height,
        source=source,
        model=camera.model,
        distortion=values[focals + 2 :],
    )
    lens.check()
    return lens
