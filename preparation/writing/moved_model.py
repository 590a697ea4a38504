"""The model of a data set that is written: the estimated one, with its images' new cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64, Int64, UInt8

from gsfw.datamanagers.colmap.model import ColmapCamera
from gsfw.datamanagers.colmap.reader import lens_of
from gsfw.datamanagers.lens import ONE_FOCAL_LENGTH, Lens
from gsfw.preparation.writing.camera_plan import CameraPlan
from gsfw.preparation.writing.written_files import MODEL_FOLDER, PARTS

if TYPE_CHECKING:
    from pycolmap import Camera, Image, Reconstruction

SHORTEST_TRACK = 2
"""Images that have to see a point, as in COLMAP."""
NO_POINT = -1


@dataclass(frozen=True)
class Sightings:
    """Observations of one image."""

    pixels: Float64[np.ndarray, "m 2"]
    points: Int64[np.ndarray, " m"]
    """Numbers of points; ``NO_POINT`` where a pixel is that of none."""

    @staticmethod
    def of(image: Image) -> Sightings:
        """The observations of an image of a model."""
        seen = list(image.points2D)
        pixels = np.array([point.xy for point in seen], np.float64).reshape(-1, 2)
        points = [point.point3D_id if point.has_point3D() else NO_POINT for point in seen]
        return Sightings(pixels, np.array(points, np.int64))


def lens_of_camera(camera: Camera, number: int) -> Lens:
    """A camera of a model as a lens.

    Raises:
        DataError: its numbers are not those of a camera.
    """
    size = (camera.width, camera.height)
    stored = ColmapCamera(camera.model_name, *size, tuple(map(float, camera.params)))
    return lens_of(stored, number, Path(MODEL_FOLDER) / PARTS[-1])


def moved_model(
    model: Reconstruction,
    plans: Mapping[int, CameraPlan],
    names: Mapping[int, str],
    seen: Mapping[int, Sightings],
    colors: Mapping[int, UInt8[np.ndarray, " 3"]],
) -> Reconstruction:
    """A model of the written images; cameras, images and points keep their numbers.

    Every camera is a rig of its own, and observations outside the written images are gone.

    Args:
        model: the estimated one.
        plans: of each camera that registered images use.
        names: of each registered image.
        seen: by each registered image.
        colors: of each point.
    """
    import pycolmap

    moved = pycolmap.Reconstruction()
    for number, plan in plans.items():
        moved.add_camera_with_trivial_rig(_camera(plan.target, number))
    places: dict[int, Int64[np.ndarray, " m"]] = {}
    for number, name in names.items():
        image = model.images[number]
        pixels, inside = plans[image.camera_id].moved(seen[number].pixels)
        places[number] = np.where(inside, np.cumsum(inside) - 1, NO_POINT)
        moved.add_image_with_trivial_frame(
            pycolmap.Image(name, pixels[inside], image.camera_id, number), image.cam_from_world()
        )
    for number, point in model.points3D.items():
        track = [
            pycolmap.TrackElement(element.image_id, place)
            for element in point.track.elements
            if (place := int(places[element.image_id][element.point2D_idx])) != NO_POINT
        ]
        if len(track) >= SHORTEST_TRACK:
            kept = pycolmap.Point3D()
            kept.xyz, kept.color, kept.track = point.xyz, colors[number], pycolmap.Track(track)
            moved.add_point3D_with_id(number, kept)
    moved.update_point_3d_errors()
    return moved


def _camera(lens: Lens, number: int) -> Camera:
    import pycolmap

    focal = (lens.fx,) if lens.model in ONE_FOCAL_LENGTH else (lens.fx, lens.fy)
    return pycolmap.Camera(
        camera_id=number,
        model=lens.model,
        width=lens.width,
        height=lens.height,
        params=[*focal, lens.cx, lens.cy, *lens.distortion],
    )
