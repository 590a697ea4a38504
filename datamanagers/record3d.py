"""The ``record3d`` format: recordings of the iPhone app Record3D.

The export "EXR + RGB" has metadata.json with rgb/0.jpg, 1.jpg, ...; a .r3d file is a ZIP archive of
metadata with rgbd/0.jpg, 1.jpg, .... Both have the size of images (w, h) and, in pixels, the matrix
of the lens (K, column by column) or the lens of each image (perFrameIntrinsicCoeffs: fx, fy, cx,
cy). A row of poses is a camera-to-world rotation (quaternion x, y, z, w) and position in metres, in
ARKit's axes: x right, y up, z back, with the world's y up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.files.reading import is_file
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.ranges import number as setting
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import Frame, Recording, missing_images, no_points
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.json_file import number, numbers, read_object
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.poses import pose_from_opengl

LAYOUTS = (("metadata.json", "rgb"), ("metadata", "rgbd"))
"""File of the cameras and folder of the images: of an export, and of an unpacked .r3d file."""
LOOKED_FOR = "metadata.json with rgb/, or metadata with rgbd/ (Record3D)"
EXTENSIONS = (".jpg", ".png")


@dataclass(kw_only=True)
class Record3dConfig(CaptureConfig):
    """Settings of the ``record3d`` format."""

    max_images: int = setting(300, at_least=2)
    """Most images that are used, spread evenly: a recording has 30 or 60 each second."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with the file of the cameras and the folder of the images."""
        found = _layout(path)
        if found is None:
            return Detection(False, LOOKED_FOR)
        return Detection(True, LOOKED_FOR, f"Record3D's {found[0].name}", priority=40)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the cameras and the headers of the images."""
        layout = _layout(path)
        if layout is None:
            raise DataError(
                f"{path} contains no {LOOKED_FOR}.",
                'Export the recording from Record3D as "EXR + RGB", or unpack its .r3d file: '
                "unzip FILE.r3d -d DIR.",
            )
        file, folder = layout
        content = read_object(file)
        total = _count(content, str(file))
        count = min(total, self.max_images)
        chosen = [round(index * (total - 1) / max(1, count - 1)) for index in range(count)]
        frames, missing = _frames(content, chosen, file, folder)
        points, colors = no_points()
        fewer = f"{len(chosen)} of {total} images are used (datamanager.max_images=N: more)"
        return Recording(
            name=path.absolute().name,
            path=path,
            frames=tuple(frames),
            points=points,
            point_colors=colors,
            notes=(
                f"{file}: {total} cameras",
                *((fewer,) if len(chosen) < total else ()),
                *missing_images(missing, len(chosen), folder),
                "not used: depth of the LiDAR sensor (init=dense finds points in the images)",
            ),
            up="y",
        )


def _layout(path: Path) -> tuple[Path, Path] | None:
    """The file of the cameras and the folder of the images."""
    for file, folder in LAYOUTS:
        # Nerfies has files of these names as well, and its cameras in a folder.
        others = (path / "dataset.json", path / "camera")
        if (path / file).is_file() and (path / folder).is_dir():
            return None if any(item.exists() for item in others) else (path / file, path / folder)
    return None


def _count(content: Mapping[str, Any], where: str) -> int:
    """The number of poses.

    Raises:
        DataError: there are none.
    """
    poses = content.get("poses")
    if not isinstance(poses, list) or not poses:
        raise DataError(
            f"{where}: there is no list of poses.", "Export the recording from Record3D again."
        )
    return len(poses)


def _frames(
    content: Mapping[str, Any], chosen: Sequence[int], file: Path, folder: Path
) -> tuple[list[Frame], list[str]]:
    """The frames, and the names of missing images."""
    frames, missing = [], []
    cameras: dict[Lens, int] = {}
    for index in chosen:
        files = (folder / f"{index}{extension}" for extension in EXTENSIONS)
        image = next((path for path in files if is_file(path)), None)
        if image is None:
            missing.append(str(index))
            continue
        where = f"{file}: image {index}"
        lens = _lens(content, index, where)
        pose = _pose(numbers(content["poses"][index], 7, f"{where}: pose"), where)
        camera = cameras.setdefault(lens, len(cameras))
        frames.append(Frame(image.name, image, read_header(image), lens, pose, camera=camera))
    return frames, missing


def _lens(content: Mapping[str, Any], index: int, where: str) -> Lens:
    own = content.get("perFrameIntrinsicCoeffs")
    if isinstance(own, list) and index < len(own):
        fx, fy, cx, cy = numbers(own[index], 4, f"{where}: perFrameIntrinsicCoeffs").tolist()
    else:
        matrix = numbers(content.get("K"), 9, f"{where}: K").tolist()
        fx, fy, cx, cy = matrix[0], matrix[4], matrix[6], matrix[7]
    width, height = (round(number(content, key, where)) for key in ("w", "h"))
    lens = Lens(fx, fy, cx, cy, width, height, where)
    lens.check()
    return lens


def _pose(row: Float64[Tensor, " 7"], where: str) -> Float64[Tensor, "4 4"]:
    """World-to-camera, with OpenCV's axes."""
    rotation = unit_matrices(row[None, [3, 0, 1, 2]])[0]
    return pose_from_opengl(torch.cat([rotation, row[4:, None]], dim=1), where)
