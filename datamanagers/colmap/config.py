"""The ``colmap`` format: a sparse model and the images it was computed from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import torch

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.files.reading import is_file
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.colmap.model import ColmapModel, model_folders, model_suffix
from gsfw.datamanagers.colmap.reader import lens_of, read_model, read_sightings
from gsfw.datamanagers.detection import describe_unrecognised
from gsfw.datamanagers.frames import Frame, Recording, missing_images
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.poses import pose_from_quaternion
from gsfw.datamanagers.upright import upright

LOOKED_FOR = "cameras, images and points3D (.bin or .txt) in sparse/0, in sparse, or in the folder"


@dataclass
class ColmapConfig(CaptureConfig):
    """Settings of the ``colmap`` format."""

    images: str = ""
    """Folder of the images, relative to the data set. Empty: images, or the data set itself."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with a model in sparse/0, in sparse, or in itself."""
        folders = model_folders(path)
        if not folders:
            return Detection(False, LOOKED_FOR, describe_unrecognised(path))
        file = folders[0] / f"cameras{model_suffix(folders[0])}"
        return Detection(True, LOOKED_FOR, str(file.relative_to(path)), priority=30)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the model and the headers of the images."""
        folders = model_folders(path)
        if not folders:
            found = describe_unrecognised(path)
            raise DataError(
                f"{path} contains no COLMAP model; looked for {LOOKED_FOR}"
                + (f"; found {found}." if found else "."),
                "Give the folder that holds sparse/ and images/.",
            )
        model = read_model(folders[0])
        root = path if self.images else _capture_root(path)
        folder = root / (self.images or ("images" if (root / "images").is_dir() else ""))
        if not folder.is_dir():
            raise DataError(f"datamanager.images={self.images}: there is no folder {folder}.")
        frames, missing = frames_of(model, folder)
        notes = [f"{model.cameras_file}: {len(model.images)} images, {len(model.points)} points"]
        if len(folders) > 1:
            others = ", ".join(str(other) for other in folders[1:])
            notes.append(f"used the largest of {len(folders)} models; the others are {others}")
        notes.extend(missing_images(missing, len(model.images), folder, has_setting=True))
        return Recording(
            name=root.resolve().name,
            path=path,
            frames=frames,
            points=torch.from_numpy(model.points),
            point_colors=torch.from_numpy(model.colors).float() / 255,
            notes=tuple(notes),
            up="-y",
            sightings=cache(
                partial(read_sightings, folders[0], model.images, [frame.name for frame in frames])
            ),
        )


def _capture_root(path: Path) -> Path:
    """Parent folder of images/: that of sparse/ if ``path`` is the folder of the model itself."""
    path = path.absolute()
    around = (path, path.parent, path.parent.parent)
    return next((folder for folder in around if (folder / "images").is_dir()), path)


def frames_of(model: ColmapModel, folder: Path) -> tuple[tuple[Frame, ...], list[str]]:
    """The images that are on disk, and the names of those that are not."""
    used = sorted({image.camera for image in model.images})
    lenses = {number: lens_of(model.cameras[number], number, model.cameras_file) for number in used}
    frames, missing = [], []
    for image in model.images:
        path = folder / image.name
        if not is_file(path):
            missing.append(image.name)
            continue
        frame = Frame(
            name=image.name,
            path=path,
            header=read_header(path),
            lens=lenses[image.camera],
            world_to_camera=pose_from_quaternion(
                image.quaternion, image.translation, f"{model.cameras_file.parent}: {image.name}"
            ),
            camera=used.index(image.camera),
        )
        frames.append(upright(frame))
    return tuple(frames), missing
