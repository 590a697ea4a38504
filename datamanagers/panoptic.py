"""The ``panoptic`` format: train_meta.json and test_meta.json of Dynamic 3D Gaussians.

The layout of Luiten et al. 2024: for each time lists over cameras of intrinsics k, world-to-camera
matrices w2c, image names fn under ims/ and camera numbers cam_id; seg/ marks the foreground, which
moves, and init_pt_cld.npz holds a point cloud.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import torch

from gsfw.core.batch import SEGMENTATION, Resampling
from gsfw.core.config import Detection
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.files.array_file import read_numbers
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.json_text import read_json
from gsfw.core.files.reading import is_file
from gsfw.datamanagers.camera_sequence import common_rate
from gsfw.datamanagers.frames import Frame, Recording, missing_images, no_points
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.map_file import MapFile
from gsfw.datamanagers.multi_camera import MultiCameraConfig, hold_out_cameras
from gsfw.datamanagers.point_file import Points, check_points
from gsfw.datamanagers.poses import pose_from_opencv, read_rows

FILES = {Split.TRAIN: "train_meta.json", Split.EVAL: "test_meta.json"}
POINTS = "init_pt_cld.npz"
LISTS = ("k", "w2c", "fn", "cam_id")


@dataclass
class PanopticConfig(MultiCameraConfig):
    """Settings of the ``panoptic`` format. By default those of test_meta.json are held out."""

    own_maps: ClassVar[frozenset[str]] = frozenset({SEGMENTATION})

    segmentation: bool = True
    """True if seg/ also gives the per-view map "segmentation", for method dynamic3dgs; false saves
    its memory. It gives the moving region of metrics anyway."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with a train_meta.json, or such a file itself."""
        found = [name for name in FILES.values() if (_folder(path) / name).is_file()]
        recognised = FILES[Split.TRAIN] in found
        return Detection(recognised, FILES[Split.TRAIN], ", ".join(found), priority=40)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read both files and the headers of the images."""
        folder = _folder(path)
        files = {
            split: _MetaFile.read(folder / name)
            for split, name in FILES.items()
            if (folder / name).is_file()
        }
        if Split.TRAIN not in files:
            raise DataError(
                f"{folder} contains no {FILES[Split.TRAIN]}.", "Give the folder that contains it."
            )
        count = min(len(file) for file in files.values())
        rate, source = common_rate((), self.fps)
        chosen = self.chosen_times(count, str(folder))
        # The same number in both files is the same camera.
        names = sorted({name for file in files.values() for name in file.cameras(chosen)}, key=int)
        frames: list[Frame] = []
        missing: list[str] = []
        for split, file in files.items():
            there, lacking = file.frames(chosen, rate, names, split if len(files) > 1 else None)
            frames, missing = frames + there, missing + lacking
        missing_note = missing_images(missing, len(frames) + len(missing), folder / "ims")
        origin = f"the data set's own split, {FILES[Split.EVAL]}"
        if self.eval_cameras:
            frames, origin = hold_out_cameras(frames, names, self.eval_cameras)
        (points, colors), point_note = _points(folder / POINTS)
        return Recording(
            name=folder.resolve().name,
            path=folder,
            frames=with_segmentation(frames) if self.segmentation else tuple(frames),
            points=points,
            point_colors=colors,
            notes=(
                *(file.note(chosen) for file in files.values()),
                self.times_note(chosen, count, rate, source),
                *missing_note,
                point_note,
            ),
            split_origin=origin,
            whole_cameras=self.whole_cameras,
        )


@dataclass(frozen=True)
class _MetaFile:
    """One of the two files."""

    path: Path
    content: Mapping[str, Any]

    @staticmethod
    def read(path: Path) -> _MetaFile:
        """Read the file.

        Raises:
            DataError: it is not JSON, its lists do not go together, or cameras have no numbers.
        """
        content = read_json(path)
        lists = [content.get(key) if isinstance(content, dict) else None for key in LISTS]
        shapes = [
            [len(inner) for inner in item]
            if isinstance(item, list) and all(isinstance(inner, list) for inner in item)
            else None
            for item in lists
        ]
        if not shapes[0] or shapes[0][0] == 0 or any(shape != shapes[0] for shape in shapes):
            raise DataError(
                f"{path}: its lists {', '.join(LISTS)} are missing, empty or of different lengths.",
                "Expected, for each of them, a list over times of lists over cameras.",
            )
        for name in (name for inner in content["cam_id"] for name in inner):
            if type(name) is not int and not (isinstance(name, str) and name.isdecimal()):
                raise JsonFields.of({"cam_id": name}, path).refuse("cam_id", "whole numbers")
        return _MetaFile(path, content)

    def __len__(self) -> int:
        return len(self.content["fn"])

    def cameras(self, times: range) -> set[str]:
        """Numbers of the cameras at these times, as names."""
        return {str(name) for time in times for name in self.content["cam_id"][time]}

    def note(self, times: range) -> str:
        """Description of the file."""
        return f"{self.path}: {len(self.cameras(times))} cameras at {len(self)} times"

    def frames(
        self, times: range, rate: float, names: list[str], split: Split | None
    ) -> tuple[list[Frame], list[str]]:
        """The frames whose images are on disk, and the names of those that are not.

        Raises:
            DataError: a camera cannot be used; it is named.
        """
        frames, missing = [], []
        for time in times:
            for position, name in enumerate(self.content["fn"][time]):
                image = self.path.parent / "ims" / str(name)
                if not is_file(image):
                    missing.append(str(name))
                    continue
                camera = names.index(str(self.content["cam_id"][time][position]))
                frames.append(
                    replace(
                        self._frame(time, position, image),
                        time=time / rate,
                        camera=camera,
                        split=split,
                    )
                )
        return frames, missing

    def _frame(self, time: int, position: int, image: Path) -> Frame:
        name = str(self.content["fn"][time][position])
        own = {key: self.content[key][time][position] for key in ("k", "w2c")}
        camera = JsonFields.of({**self.content, **own}, self.path, name)
        k = camera.numbers("k", 3, 3)
        lens = Lens(
            fx=float(k[0, 0]),
            fy=float(k[1, 1]),
            cx=float(k[0, 2]),
            cy=float(k[1, 2]),
            width=round(camera.number("w")),
            height=round(camera.number("h")),
            source=camera.at,
        )
        lens.check()
        moving = (self.path.parent / "seg" / name).with_suffix(".png")
        return Frame(
            name=name,
            path=image,
            header=read_header(image),
            lens=lens,
            world_to_camera=pose_from_opencv(read_rows(camera, "w2c"), camera.at),
            moving=moving if is_file(moving) else None,
        )


def with_segmentation(frames: Sequence[Frame]) -> tuple[Frame, ...]:
    """Frames with the per-view map "segmentation", if every frame has a file of the foreground."""
    files = [frame.moving for frame in frames]
    return tuple(
        replace(frame, maps={**frame.maps, SEGMENTATION: MapFile(file, Resampling.NEAREST)})
        if file is not None and None not in files
        else frame
        for frame, file in zip(frames, files, strict=True)
    )


def _folder(path: Path) -> Path:
    return path.parent if path.name in FILES.values() else path


def _points(file: Path) -> tuple[Points, str]:
    """The cloud's points and colours (what is foreground is not used), and a note on them."""
    if not file.is_file():
        return no_points(), f"there are no points (looked for {file.name})"
    advice = (
        "Expected data of the shape [points, 7]: position, colour, foreground; remove the file to "
        "train without points."
    )
    try:
        cloud = torch.from_numpy(read_numbers(file, "data"))
    except DataError as error:
        raise DataError(f"{file} does not hold points: {error.message}", advice) from error
    if cloud.ndim != 2 or cloud.shape[1] < 6:
        raise DataError(
            f"{file} does not hold points: its data has the shape {list(cloud.shape)}.", advice
        )
    points = check_points(cloud[:, :3], cloud[:, 3:6].clamp(0, 1).float(), file)
    return points, f"{file}: {len(cloud)} points"
