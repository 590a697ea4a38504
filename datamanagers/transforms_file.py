"""Reader of transforms*.json: the files of instant-ngp, nerfstudio, NeRF-synthetic and D-NeRF.

A setting of a frame goes before the same setting of the whole file. Poses are camera-to-world with
OpenGL axes. See https://docs.nerf.studio/quickstart/data_conventions.html.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any

from gsfw.core.batch import Resampling
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.files.json_fields import CORRECT, JsonFields
from gsfw.core.files.json_text import read_json
from gsfw.core.files.reading import is_file
from gsfw.datamanagers.frames import Frame
from gsfw.datamanagers.images import EXTENSIONS, Header, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.map_file import DEPTH, MILLIMETRE, MapFile
from gsfw.datamanagers.poses import pose_from_opengl, read_rows
from gsfw.datamanagers.transforms_lens import FOCAL_KEYS, read_lens
from gsfw.datamanagers.upright import upright

SPLIT_FILES = {name: f"transforms_{name}.json" for name in ("train", "test", "val")}
"""File names of NeRF-synthetic and D-NeRF, which have one file per split."""

DEPTH_KEY = "depth_file_path"
CAMERA_KEY = "camera_index"
"""Number of the camera that took a frame, counted from 0; a key of our own."""
MOST_CAMERAS = 1_000_000
"""A number beyond is none of a camera."""


@dataclass(frozen=True)
class TransformsFile:
    """A transforms*.json."""

    path: Path
    content: Mapping[str, Any]
    with_depth: bool = False
    """True if depth maps are looked at."""

    @staticmethod
    def read(path: Path) -> TransformsFile:
        """Read the file.

        Raises:
            DataError: it is not JSON, or contains no frames.
        """
        content = read_json(path)
        frames = content.get("frames") if isinstance(content, dict) else None
        if not isinstance(frames, list) or not all(isinstance(frame, dict) for frame in frames):
            raise DataError(
                f"{path} has no list of frames.",
                'Expected {"frames": [{"file_path": ..., "transform_matrix": ...}, ...]}.',
            )
        if not frames:
            raise DataError(f"{path}: its list of frames is empty.", CORRECT)
        return TransformsFile(path, content)

    def frames(self, split: Split | None = None) -> tuple[list[Frame], list[str]]:
        """The frames whose images are on disk, and the names of those that are not.

        Raises:
            DataError: a frame cannot be used; it is named.
        """
        frames, missing = [], []
        for index, entry in enumerate(self.content["frames"]):
            numbered = JsonFields.of(entry, self.path, f"frame {index} (counted from 0)")
            name = self._name(numbered.text("file_path"))
            if not name:
                raise numbered.refuse("file_path", "the path of an image")
            image = self.find(name)
            if image is None:
                missing.append(name)
                continue
            fields = replace(numbered, where=f"frame {name}")
            frames.append(replace(self._frame(name, fields, image), split=split))
        return frames, missing

    @cached_property
    def _dropped(self) -> int:
        """Number of leading folders of the stated paths that are not in the file's folder.

        instant-ngp's colmap2nerf.py writes paths relative to the folder that it was started in.
        """
        stated = [str(entry.get("file_path", "")) for entry in self.content["frames"]]
        paths = [PurePosixPath(plain_name(name)).parts for name in stated]
        for count in range(min(map(len, paths))):
            ends = [parts[count:] for parts in paths]
            distinct = len(set(ends)) == len(set(paths))
            if distinct and any(self.find(PurePosixPath(*end).as_posix()) for end in ends):
                return count
        return 0

    def _name(self, file_path: str) -> str:
        """The name of an image, from where it is in the file's folder on."""
        name = plain_name(file_path)
        parts = PurePosixPath(name).parts
        return PurePosixPath(*parts[self._dropped :]).as_posix() if self._dropped else name

    def path_note(self) -> tuple[str, ...]:
        """The note on folders of the stated paths that are left out; none if none are."""
        if not self._dropped:
            return ()
        parts = PurePosixPath(plain_name(str(self.content["frames"][0]["file_path"]))).parts
        left_out = PurePosixPath(*parts[: self._dropped]).as_posix()
        return (f"images are found without the beginning of their paths ({left_out}/)",)

    @property
    def numbers_cameras(self) -> bool:
        """True if every frame says which camera took it, as those that gsfw wrote do."""
        return all(CAMERA_KEY in entry for entry in self.content["frames"])

    def times(self) -> tuple[float, ...]:
        """The times of all frames, whether or not their images are on disk."""
        entries = (JsonFields.of(entry, self.path) for entry in self.content["frames"])
        times = [entry.optional_number("time") for entry in entries]
        return tuple(time for time in times if time is not None)

    def depth_note(self) -> tuple[str, ...]:
        """The note on depth maps that are not loaded; none when the file names none."""
        count = sum(bool(entry.get(DEPTH_KEY)) for entry in self.content["frames"])
        if count == 0 or self.with_depth:
            return ()
        return (f"{count} frames have depth maps: not used (datamanager.depth=true loads them)",)

    def names(self, key: str) -> frozenset[str]:
        """A list of frames; empty when the file does not have it.

        Raises:
            DataError: it is not a list of names.
        """
        if not self.content.get(key):
            return frozenset()
        names = JsonFields.of(self.content, self.path).texts(key)
        return frozenset(self._name(name) for name in names)

    def find(self, name: str) -> Path | None:
        """A file that the JSON names, with or without its extension."""
        path = self.path.parent / name
        candidates = (path, *(Path(f"{path}{end}") for end in EXTENSIONS))
        return next((candidate for candidate in candidates if is_file(candidate)), None)

    def _frame(self, name: str, entry: JsonFields, image: Path) -> Frame:
        header = read_header(image)
        frame = Frame(
            name=name,
            path=image,
            header=header,
            lens=self._lens(entry, header),
            world_to_camera=pose_from_opengl(read_rows(entry, "transform_matrix"), entry.at),
            camera=_camera(entry),
            time=entry.optional_number("time"),
            mask=self._named(entry, "mask_path", "use every pixel"),
            moving=self._named(entry, "motion_mask_path", "let evaluation detect what moves"),
            maps=self._maps(entry),
        )
        return upright(frame)

    def _whole(self, entry: JsonFields) -> JsonFields:
        """The settings of a frame, and those of the file that it does not have."""
        return replace(entry, values={**self.content, **entry.values})

    def _maps(self, entry: JsonFields) -> dict[str, MapFile]:
        """The depth map that a frame names, which nerfstudio takes to be in millimetres."""
        if not self.with_depth:
            return {}
        path = self._named(entry, DEPTH_KEY, "train without it", "depth map")
        if path is None:
            return {}
        whole = self._whole(entry)
        unit = whole.optional_number("depth_unit_scale_factor")
        if unit is not None and unit <= 0:
            raise whole.refuse("depth_unit_scale_factor", "a number above 0")
        return {DEPTH: MapFile(path, Resampling.DEPTH, MILLIMETRE if unit is None else unit)}

    def _named(self, entry: JsonFields, key: str, without: str, noun: str = "mask") -> Path | None:
        """The file that a frame names; ``None`` when it names none."""
        name = entry.values.get(key)
        if not name:
            return None
        mask = self.find(self._name(str(name)))
        if mask is None:
            raise DataError(
                f"{entry.at}: its {noun} {name} is not on disk.",
                f"Put it there, or remove {key} to {without}.",
            )
        return mask

    def _lens(self, entry: JsonFields, header: Header) -> Lens:
        whole = self._whole(entry)
        focal = entry if any(key in entry for key in FOCAL_KEYS) else whole
        return read_lens(whole, focal, header, str(self.path))


def plain_name(file_path: str) -> str:
    """A path as JSON files give it, with forward slashes and no leading "./"."""
    return file_path.replace("\\", "/").removeprefix("./")


def _camera(entry: JsonFields) -> int:
    """Number of the camera that a frame states; 0 if it states none."""
    index = entry.values.get(CAMERA_KEY, 0)
    if type(index) is not int or not 0 <= index < MOST_CAMERAS:
        raise entry.refuse(CAMERA_KEY, f"the camera's number from 0 on, or no {CAMERA_KEY} at all")
    return index
