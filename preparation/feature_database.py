"""COLMAP's database: images, their cameras and features, one image at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gsfw.core.files.atomic import readable_write_errors
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.disk import check_room
from gsfw.preparation.image_set import ImageSet
from gsfw.preparation.native import readable_native_errors
from gsfw.preparation.panorama_views import DIRECTIONS
from gsfw.preparation.sift import ImageFeatures

if TYPE_CHECKING:
    from pycolmap import Camera, Image


def camera_of(group: CameraGroup) -> Camera:
    """COLMAP's camera of a group before calibration."""
    import pycolmap

    camera = pycolmap.Camera.create_from_model_name(
        group.number, group.model, group.focal, group.width, group.height
    )
    camera.has_prior_focal_length = bool(group.focal_origin)
    return camera


def image_numbers(images: ImageSet) -> dict[str, int]:
    """COLMAP's image ids by name: positions in the set, counted from 1."""
    return {image.name: number for number, image in enumerate(images.images, 1)}


class FeatureDatabase:
    """A database that features are written into; open while it is used as a context."""

    def __init__(self, path: Path, images: ImageSet, groups: Sequence[CameraGroup]) -> None:
        """Open it, or make it.

        Raises:
            OutputError: its folder cannot be written to, or the disk is nearly full.
            DataError: the file is no database.
        """
        import pycolmap

        self._path = path
        with readable_write_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        check_room(path)
        with readable_native_errors("open the features", path):
            self._database = pycolmap.Database.open(path)
        self._images, self._numbers = images, image_numbers(images)
        self._groups: Mapping[str, CameraGroup] = {
            name: group for group in groups for name in group.images
        }
        self._frames: dict[str, int] = {}
        for image in images.images:
            self._frames.setdefault(image.shot, self._numbers[image.name])

    def __enter__(self) -> FeatureDatabase:
        return self

    def __exit__(self, *error: object) -> None:
        self._database.close()

    def has(self, name: str) -> bool:
        """True if an image and its features are there."""
        number = self._numbers[name]
        return bool(
            self._database.exists_image(number) and self._database.exists_descriptors(number)
        )

    def write(self, features: ImageFeatures) -> None:
        """Write an image and its features, and its camera where it is the first of it.

        All of it or, if the process ends in between, nothing.

        Raises:
            DataError: the database does not take them.
            OutputError: the disk is nearly full.
        """
        import pycolmap

        check_room(self._path)
        number, group = self._numbers[features.name], self._groups[features.name]
        with (
            readable_native_errors("store features", self._path),
            pycolmap.DatabaseTransaction(self._database),
        ):
            if not self._database.exists_camera(group.number):
                self._write_camera(group)
            image = pycolmap.Image(name=features.name, camera_id=group.number, image_id=number)
            self._database.write_image(image, use_image_id=True)
            self._write_frame(image, group)
            self._database.write_keypoints(number, features.keypoints)
            sift = pycolmap.FeatureExtractorType.SIFT
            descriptors = pycolmap.FeatureDescriptors(type=sift, data=features.descriptors)
            self._database.write_descriptors(number, descriptors)

    def _write_frame(self, image: Image, group: CameraGroup) -> None:
        """The frame of an image: views of one panorama share one, with the number of the first."""
        import pycolmap

        number = self._frames[self._images.by_name[image.name].shot]
        if self._database.exists_frame(number):
            frame = self._database.read_frame(number)
            frame.add_data_id(image.data_id)
            self._database.update_frame(frame)
            return
        frame = pycolmap.Frame(frame_id=number, rig_id=group.rig or group.number)
        frame.add_data_id(image.data_id)
        self._database.write_frame(frame, use_frame_id=True)

    def _write_camera(self, group: CameraGroup) -> None:
        """A camera and its rig, with all cameras of the rig, which COLMAP wants to know at once."""
        import pycolmap

        together = {group.number: group}
        if group.rig is not None:
            together = {one.number: one for one in self._groups.values() if one.rig == group.rig}
        first, *others = (together[number] for number in sorted(together))
        rig = pycolmap.Rig(rig_id=first.number)
        for one in (first, *others):
            camera = camera_of(one)
            self._database.write_camera(camera, use_camera_id=True)
            if one is first:
                rig.add_ref_sensor(camera.sensor_id)
            else:
                axes, own = (DIRECTIONS[of.view or 0].from_panorama for of in (first, one))
                turn = pycolmap.Rotation3d(own @ axes.T)
                rig.add_sensor(camera.sensor_id, pycolmap.Rigid3d(turn, np.zeros(3)))
        self._database.write_rig(rig, use_rig_id=True)
