"""The ``metashape`` format: the cameras XML of Agisoft Metashape, and the images it names.

Facts are those of the Metashape manual (appendix "Camera models") and of exported files. Cameras
look along +z with x right and y down; their 4x4 transforms lead from the camera to the chunk, and
the transform of the chunk's component (or of the chunk) from there to the world.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from gsfw.core.config import Detection
from gsfw.datamanagers.frames import Frame, Recording, missing_images
from gsfw.datamanagers.image_folder import ImageFolder, ImageFolderConfig, left_out, only_file
from gsfw.datamanagers.metashape_file import (
    MetashapeCamera,
    MetashapeFile,
    has_poses,
    is_metashape,
)

LOOKED_FOR = "an XML file of Metashape's cameras with images/, or with images beside it"


@dataclass
class MetashapeConfig(ImageFolderConfig):
    """Settings of the ``metashape`` format."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with such a file, or the file itself; looks at the beginnings of XML files."""
        files = _files(path)
        if not files:
            return Detection(False, LOOKED_FOR)
        return Detection(True, LOOKED_FOR, f"Metashape's {files[0].name}", priority=22)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the file, its points and the headers of the images."""
        files = _files(path)
        placed = [file for file in files if has_poses(file)] if len(files) > 1 else []
        file = only_file(
            path,
            placed or files,
            "XML file of Metashape's cameras",
            "Give the file itself (File > Export > Export Cameras in Metashape).",
        )
        chunk = MetashapeFile.read(file)
        root = file.absolute().parent
        images = self.image_folder(root)
        frames, missing = _frames(chunk.cameras, images, str(file))
        total = len(chunk.cameras)
        (points, colors), point_note = self.start_points(root)
        return Recording(
            name=root.name,
            path=file,
            frames=tuple(frames),
            points=points,
            point_colors=colors,
            notes=(
                f"{file}: {total} cameras with a pose",
                *chunk.notes,
                *left_out(chunk.disabled, "that are disabled in Metashape"),
                *left_out(chunk.unaligned, "that Metashape did not align"),
                *left_out(chunk.slaves, "of a rig's slave cameras, which are not read,"),
                *missing_images(missing, total, images.path, has_setting=True),
                *point_note,
            ),
            up=chunk.up,
        )


def _frames(
    cameras: tuple[MetashapeCamera, ...], images: ImageFolder, source: str
) -> tuple[list[Frame], list[str]]:
    """The frames whose images are on disk, and the labels of those that are not."""
    numbers = {n: i for i, n in enumerate(sorted({camera.sensor for camera in cameras}))}
    frames, missing = [], []
    for camera in cameras:
        image = images.find(camera.label, source)
        if image is None:
            missing.append(camera.label)
            continue
        number = numbers[camera.sensor]
        frames.append(images.frame(image, camera.lens, camera.world_to_camera, number))
    return frames, missing


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        return [item for item in sorted(path.glob("*.[xX][mM][lL]")) if is_metashape(item)]
    return [path] if path.suffix.lower() == ".xml" and is_metashape(path) else []
