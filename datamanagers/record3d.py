"""The ``record3d`` format: recordings of the iPhone app Record3D.

The export "EXR + RGB" has metadata.json with rgb/0.jpg, 1.jpg, ...; a .r3d file is a ZIP archive of
metadata with rgbd/0.jpg, 1.jpg, .... Both have the size of images (w, h) and, in pixels, the matrix
of the lens (K, column by column) or the lens of each image (perFrameIntrinsicCoeffs: fx, fy, cx,
cy). A row of poses is a camera-to-world rotation (quaternion x, y, z, w) and position in metres, in
ARKit's axes: x right, y up, z back, with the world's y up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.reading import is_file
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.ranges import number as setting
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import Frame, Recording, missing_images, no_points
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.poses import pose_from_opengl

LAYOUTS = (("metadata.json", "rgb"), ("metadata", "rgbd"))
"""File of the cameras and folder of the images: of an export, and of an unpacked .r3d file."""
LOOKED_FOR = "metadata.json with rgb/, or metadata with rgbd/ (Record3D)"
OWN_LENS = "perFrameIntrinsicCoeffs"
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
        content = JsonFields.read(file)
        total = _count(content)
        count = min(total, self.max_images)
        chosen = [round(index * (total - 1) / max(1, count - 1)) for index in range(count)]
        frames, missing = _frames(content, chosen, folder)
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
            left_out=frozenset(map(str, set(range(total)).difference(chosen))),
        )


def _layout(path: Path) -> tuple[Path, Path] | None:
    """The file of the cameras and the folder of the images."""
    for file, folder in LAYOUTS:
        # Nerfies has files of these names as well, and its cameras in a folder.
        others = (path / "dataset.json", path / "camera")
        if (path / file).is_file() and (path / folder).is_dir():
            return None if any(item.exists() for item in others) else (path / file, path / folder)
    return None


def _count(content: JsonFields) -> int:
    """The number of poses.

    Raises:
        DataError: there are none.
    """
    poses = content.values.get("poses")
    if not isinstance(poses, list) or not poses:
        raise content.refuse("poses", "a list of poses")
    return len(poses)


def _frames(
    content: JsonFields, chosen: Sequence[int], folder: Path
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
        entry = _entry(content, index)
        lens, pose = _lens(entry), _pose(entry)
        camera = cameras.setdefault(lens, len(cameras))
        frames.append(Frame(image.name, image, read_header(image), lens, pose, camera=camera))
    return frames, missing


def _entry(content: JsonFields, index: int) -> JsonFields:
    """The settings of one image: its pose, and its own lens where it has one."""
    values = {**content.values, "pose": content.values["poses"][index]}
    own = values.pop(OWN_LENS, None)
    if isinstance(own, list) and index < len(own):
        values[OWN_LENS] = own[index]
    return JsonFields.of(values, content.path, f"image {index}")


def _lens(entry: JsonFields) -> Lens:
    if OWN_LENS in entry:
        fx, fy, cx, cy = entry.numbers(OWN_LENS, 4).tolist()
    else:
        fx, _, _, _, fy, _, cx, cy, _ = entry.numbers("K", 9).tolist()
    width, height = (round(entry.number(key)) for key in ("w", "h"))
    lens = Lens(fx, fy, cx, cy, width, height, entry.at)
    lens.check()
    return lens


def _pose(entry: JsonFields) -> Float64[Tensor, "4 4"]:
    """World-to-camera, with OpenCV's axes."""
    row = torch.from_numpy(entry.numbers("pose", 7))
    rotation = unit_matrices(row[None, [3, 0, 1, 2]])[0]
    return pose_from_opengl(torch.cat([rotation, row[4:, None]], dim=1), entry.at)
