"""The ``openmvg`` format: sfm_data.json of OpenMVG.

Poses are a world-to-camera rotation and the camera's centre, OpenCV axes. OpenMVG counts pixels
from the centre of the first one (its features and its undistortion do), gsfw from its corner:
principal points move by half a pixel. Distortion is OpenCV's in the order k1, k2, k3, t1, t2.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.reading import is_folder
from gsfw.datamanagers.brown import brown_lens, fisheye_lens
from gsfw.datamanagers.frames import Frame, Recording, missing_images, no_points
from gsfw.datamanagers.image_folder import ImageFolder, ImageFolderConfig, left_out
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.point_file import Points
from gsfw.datamanagers.poses import pose_from_center

FILES = ("sfm_data.json", "sfm_data_expanded.json", "robust.json")
"""File names of OpenMVG's programs."""
LOOKED_FOR = f"{FILES[0]} of OpenMVG with its images"
HALF = 0.5
"""From OpenMVG's pixel coordinates to those where the first pixel's centre is at (0.5, 0.5)."""
DISTORTIONS = {"disto_k1": 1, "disto_k3": 3, "disto_t2": 5, "fisheye": 4}
"""Names of the distortion parameters, and their number."""
NAME_ID = 0x7FFFFFFF
"""The bits of a polymorphic_id that tell types; the highest says that the name is given, too."""


@dataclass
class OpenMvgConfig(ImageFolderConfig):
    """Settings of the ``openmvg`` format."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with a sfm_data.json, or such a file itself."""
        file = _file(path)
        if file is None:
            return Detection(False, LOOKED_FOR, _binary(path))
        return Detection(True, LOOKED_FOR, file.name, priority=24)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the file and the headers of the images."""
        file = _file(path)
        if file is None:
            found = _binary(path)
            raise DataError(
                f"{path} contains no {FILES[0]}" + (f"; found {found}." if found else "."),
                "Give the folder that contains it, or the file.",
            )
        content = JsonFields.read(file)
        root = file.absolute().parent
        images = self._images_of(content, root)
        views = [view for _, view in _entries(content, "views")]
        poses: dict[int | str | None, JsonFields] = dict(_entries(content, "extrinsics"))
        placed = [view for view in views if _key(view, "id_pose") in poses]
        if not placed:
            raise DataError(
                f"{file}: none of its {len(views)} views has a pose.",
                "Give the file that OpenMVG's reconstruction wrote, not that of its listing.",
            )
        frames, missing = _frames(placed, poses, _lenses(content), images)
        without = [_name(view) for view in views if _key(view, "id_pose") not in poses]
        (points, colors), point_note = self.start_points(root, _points(content))
        return Recording(
            name=root.name,
            path=file,
            frames=tuple(frames),
            points=points,
            point_colors=colors,
            notes=(
                f"{file}: {len(views)} views, {len(points)} points",
                *left_out(without, "without a pose"),
                *missing_images(missing, len(placed), images.path, has_setting=True),
                *point_note,
            ),
            up="-y",
        )

    def _images_of(self, content: JsonFields, root: Path) -> ImageFolder:
        """The folder of images that the file names, if it exists; else the file's own."""
        stated = content.values.get("root_path")
        if not self.images and isinstance(stated, str) and stated:
            for folder in (Path(stated), root / Path(stated.replace("\\", "/")).name):
                if is_folder(folder):
                    return ImageFolder(folder)
        return self.image_folder(root)


def _file(path: Path) -> Path | None:
    if path.is_file():
        return path if path.name in FILES else None
    return next((path / name for name in FILES if (path / name).is_file()), None)


def _binary(path: Path) -> str:
    """Remedy for a binary file, which is not read; empty if there is none."""
    found = sorted(path.glob("sfm_data*.bin")) if path.is_dir() else []
    if not found:
        return ""
    name = found[0].name
    return (
        f"{name}; write it as JSON (openMVG_main_ConvertSfM_DataFormat -i {name} -o {FILES[0]} "
        "-V -I -E -S)"
    )


def _entries(content: JsonFields, name: str) -> Iterator[tuple[int | str, JsonFields]]:
    """Keys and values of one of the file's maps, as the library cereal writes them."""
    for entry in content.objects(name):
        value, key = entry.fields("value"), _key(entry, "key")
        if "ptr_wrapper" in value:
            data = value.fields("ptr_wrapper").fields("data")
            # Newer versions write the base class apart from what a class adds to it.
            base = data.fields("value0", {})
            value = replace(value, values={**value.values, **data.values, **base.values})
        if key is None:
            raise entry.refuse("key", "a number")
        yield key, value


def _key(entry: JsonFields, name: str) -> int | str | None:
    """A key of a map, or the reference to it; ``None`` for what can be none."""
    value = entry.values.get(name)
    return value if isinstance(value, int | str) else None


def _name(view: JsonFields) -> str:
    return str(view.values.get("filename", ""))


def _lenses(content: JsonFields) -> dict[int | str, Lens]:
    """The lenses by their key; a type's name is given once, and then its number alone."""
    lenses: dict[int | str, Lens] = {}
    names: dict[int, str] = {}
    for key, found in _entries(content, "intrinsics"):
        entry = JsonFields.of(found.values, content.path, f"intrinsic {key}")
        identifier = round(entry.number("polymorphic_id", 0.0)) & NAME_ID
        kind = names.setdefault(identifier, str(entry.values.get("polymorphic_name", "?")))
        if "focal_length" not in entry:
            raise DataError(
                f"{entry.at}: images of {kind} cameras cannot be trained on.",
                "Expected a pinhole (with radial or Brown distortion) or a fisheye.",
            )
        lenses[key] = _lens(entry, kind)
    return lenses


def _lens(entry: JsonFields, kind: str) -> Lens:
    focal = entry.number("focal_length")
    cx, cy = (entry.numbers("principal_point", 2) + HALF).tolist()
    width, height = (round(entry.number(key)) for key in ("width", "height"))
    pinhole = Lens(focal, focal, cx, cy, width, height, entry.at)
    pinhole.check()
    found = next((key for key in DISTORTIONS if key in entry), None)
    if found is None:
        if kind not in ("pinhole", "?"):
            raise DataError(
                f"{entry.at}: cameras of the type {kind} cannot be used.",
                f"Expected one with {', '.join(DISTORTIONS)}, or a pinhole.",
            )
        return pinhole
    values = entry.numbers(found, DISTORTIONS[found]).tolist()
    if found == "fisheye":
        k1, k2, k3, k4 = values
        return fisheye_lens(pinhole, (k1, k2, k3, k4), (0.0, 0.0))
    k1, k2, k3, t1, t2 = (*values, 0.0, 0.0, 0.0, 0.0)[:5]
    return brown_lens(pinhole, (k1, k2, k3, 0.0), (t1, t2))


def _frames(
    views: list[JsonFields],
    poses: Mapping[int | str | None, JsonFields],
    lenses: Mapping[int | str, Lens],
    images: ImageFolder,
) -> tuple[list[Frame], list[str]]:
    """The frames whose images are on disk, and the names of those that are not."""
    frames, missing = [], []
    numbers_of = {key: camera for camera, key in enumerate(lenses)}
    for view in (replace(view, where=f"view {_name(view)}") for view in views):
        local = str(view.values.get("local_path", "")).strip("/")
        image = images.find(f"{local}/{_name(view)}".lstrip("/"), view.at)
        if image is None:
            missing.append(_name(view))
            continue
        key = _key(view, "id_intrinsic")
        if key is None or key not in lenses:
            raise view.refuse("id_intrinsic", "a key of intrinsics")
        pose = _pose(replace(poses[_key(view, "id_pose")], where=view.where))
        frames.append(images.frame(image, lenses[key], pose, numbers_of[key]))
    return frames, missing


def _pose(entry: JsonFields) -> Float64[Tensor, "4 4"]:
    rotation = torch.from_numpy(entry.numbers("rotation", 3, 3))
    center = torch.from_numpy(entry.numbers("center", 3))
    return pose_from_center(rotation, center, entry.at)


def _points(content: JsonFields) -> Points:
    """The structure's points, which have no colour: grey."""
    if not content.values.get("structure"):
        return no_points()
    places = np.stack([entry.numbers("X", 3) for _, entry in _entries(content, "structure")])
    return torch.from_numpy(places), torch.full((len(places), 3), 0.5)
