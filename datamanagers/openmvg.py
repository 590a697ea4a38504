"""The ``openmvg`` format: sfm_data.json of OpenMVG.

Poses are a world-to-camera rotation and the camera's centre, OpenCV axes. OpenMVG counts pixels
from the centre of the first one (its features and its undistortion do), gsfw from its corner:
principal points move by half a pixel. Distortion is OpenCV's in the order k1, k2, k3, t1, t2.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float64
from torch import Tensor

from gsfw.core.config import Detection
from gsfw.core.errors import DataError
from gsfw.core.files.reading import is_folder
from gsfw.datamanagers.brown import brown_lens, fisheye_lens
from gsfw.datamanagers.frames import Frame, Recording, missing_images, no_points
from gsfw.datamanagers.image_folder import ImageFolder, ImageFolderConfig, left_out
from gsfw.datamanagers.json_file import mapping, number, numbers, read_object
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
        content = read_object(file)
        root = file.absolute().parent
        images = self._images_of(content, root)
        views = [view for _, view in _entries(content, "views", file)]
        poses = {key: entry for key, entry in _entries(content, "extrinsics", file)}
        placed = [view for view in views if _key(view.get("id_pose")) in poses]
        if not placed:
            raise DataError(
                f"{file}: none of its {len(views)} views has a pose.",
                "Give the file that OpenMVG's reconstruction wrote, not that of its listing.",
            )
        frames, missing = _frames(placed, poses, _lenses(content, file), images, file)
        without = [_name(view) for view in views if _key(view.get("id_pose")) not in poses]
        (points, colors), point_note = self.start_points(root, _points(content, file))
        return Recording(
            name=root.name,
            path=file,
            frames=tuple(frames),
            points=points,
            point_colors=colors,
            notes=(
                f"{file}: {len(views)} views, {len(points)} points",
                *left_out(without, "without a pose"),
                *missing_images(missing, len(placed), images.path),
                *point_note,
            ),
            up="-y",
        )

    def _images_of(self, content: Mapping[str, Any], root: Path) -> ImageFolder:
        """The folder of images that the file names, if it exists; else the file's own."""
        stated = content.get("root_path")
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


def _entries(
    content: Mapping[str, Any], key: str, file: Path
) -> Iterator[tuple[Any, Mapping[str, Any]]]:
    """Keys and values of one of the file's maps, as the library cereal writes them."""
    entries = content.get(key)
    if not isinstance(entries, list):
        raise DataError(f"{file}: it has no list of {key}.", "Copy the file again.")
    for entry in entries:
        where = f"{file}: {key}"
        outer = mapping(entry, where)
        value = mapping(outer.get("value"), where)
        if "ptr_wrapper" in value:
            data = mapping(mapping(value["ptr_wrapper"], where).get("data"), where)
            # Newer versions write the base class apart from what a class adds to it.
            value = {**value, **data, **mapping(data.get("value0", {}), where)}
        found = _key(outer.get("key"))
        if found is None:
            raise DataError(
                f"{where}: a key is {outer.get('key')!r:.60}; expected a number.",
                "Copy the file again.",
            )
        yield found, value


def _key(value: object) -> int | str | None:
    """A key of a map, or the reference to it; ``None`` for what can be none."""
    return value if isinstance(value, int | str) else None


def _name(view: Mapping[str, Any]) -> str:
    return str(view.get("filename", ""))


def _lenses(content: Mapping[str, Any], file: Path) -> dict[Any, Lens]:
    """The lenses by their key; a type's name is given once, and then its number alone."""
    lenses: dict[Any, Lens] = {}
    names: dict[int, str] = {}
    for key, entry in _entries(content, "intrinsics", file):
        where = f"intrinsic {key} of {file}"
        identifier = round(number(entry, "polymorphic_id", where, 0.0)) & NAME_ID
        kind = names.setdefault(identifier, str(entry.get("polymorphic_name", "?")))
        if "focal_length" not in entry:
            raise DataError(
                f"{where}: images of {kind} cameras cannot be trained on.",
                "Expected a pinhole (with radial or Brown distortion) or a fisheye.",
            )
        lenses[key] = _lens(entry, kind, where)
    return lenses


def _lens(entry: Mapping[str, Any], kind: str, where: str) -> Lens:
    focal = number(entry, "focal_length", where)
    center = numbers(entry.get("principal_point"), 2, f"{where}: principal_point") + HALF
    width, height = (round(number(entry, key, where)) for key in ("width", "height"))
    pinhole = Lens(focal, focal, float(center[0]), float(center[1]), width, height, where)
    pinhole.check()
    found = next((key for key in DISTORTIONS if key in entry), None)
    if found is None:
        if kind not in ("pinhole", "?"):
            raise DataError(
                f"{where}: cameras of the type {kind} cannot be used.",
                f"Expected one with {', '.join(DISTORTIONS)}, or a pinhole.",
            )
        return pinhole
    values = numbers(entry[found], DISTORTIONS[found], f"{where}: {found}").tolist()
    if found == "fisheye":
        k1, k2, k3, k4 = values
        return fisheye_lens(pinhole, (k1, k2, k3, k4), (0.0, 0.0))
    k1, k2, k3, t1, t2 = (*values, 0.0, 0.0, 0.0, 0.0)[:5]
    return brown_lens(pinhole, (k1, k2, k3, 0.0), (t1, t2))


def _frames(
    views: list[Mapping[str, Any]],
    poses: Mapping[Any, Mapping[str, Any]],
    lenses: Mapping[Any, Lens],
    images: ImageFolder,
    file: Path,
) -> tuple[list[Frame], list[str]]:
    """The frames whose images are on disk, and the names of those that are not."""
    frames, missing = [], []
    numbers_of = {key: camera for camera, key in enumerate(lenses)}
    for view in views:
        where = f"{file}: view {_name(view)}"
        local = str(view.get("local_path", "")).strip("/")
        image = images.find(f"{local}/{_name(view)}".lstrip("/"), where)
        if image is None:
            missing.append(_name(view))
            continue
        key = _key(view.get("id_intrinsic"))
        if key not in lenses:
            raise DataError(f"{where}: there is no intrinsic {key}.", "Copy the file again.")
        pose = _pose(poses[_key(view.get("id_pose"))], where)
        frames.append(images.frame(image, lenses[key], pose, numbers_of[key]))
    return frames, missing


def _pose(entry: Mapping[str, Any], where: str) -> Float64[Tensor, "4 4"]:
    rotation = numbers(entry.get("rotation"), 9, f"{where}: rotation").reshape(3, 3)
    return pose_from_center(rotation, numbers(entry.get("center"), 3, f"{where}: center"), where)


def _points(content: Mapping[str, Any], file: Path) -> Points:
    """The structure's points, which have no colour: grey."""
    if not content.get("structure"):
        return no_points()
    entries = [entry for _, entry in _entries(content, "structure", file)]
    places = [numbers(entry.get("X"), 3, f"{file}: structure") for entry in entries]
    return torch.stack(places), torch.full((len(places), 3), 0.5)
