"""The ``nerfies`` format: the data sets of Nerfies (Park et al. 2021) and HyperNeRF (2021).

Facts about the layout are those of the authors' documentation: a camera has an orientation (world
to camera, OpenCV axes), a position in the world, a focal length in pixels of the images at full
size, and radial distortion k1, k2, k3 and tangential p1, p2 with OpenCV's formulas. The centre and
scale of scene.json are the authors' normalisation; gsfw finds its own, and keeps the world.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import torch

from gsfw.core.config import Detection
from gsfw.core.datamanager import Split
from gsfw.core.errors import DataError
from gsfw.core.files.array_file import read_numbers
from gsfw.core.files.json_fields import JsonFields
from gsfw.core.files.reading import is_file
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.frames import Frame, Recording, missing_images, no_points
from gsfw.datamanagers.images import EXTENSIONS, read_header
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.point_file import Points, check_points
from gsfw.datamanagers.poses import pose_from_center

FILES = ("dataset.json", "metadata.json")
LOOKED_FOR = "dataset.json and metadata.json with camera/ and rgb/"


@dataclass
class NerfiesConfig(CaptureConfig):
    """Settings of the ``nerfies`` format."""

    @classmethod
    def detect(cls, path: Path) -> Detection:
        """A folder with both files and the cameras."""
        if not all((path / name).is_file() for name in FILES) or not (path / "camera").is_dir():
            return Detection(False, LOOKED_FOR)
        return Detection(True, LOOKED_FOR, f"{' and '.join(FILES)} with camera/", priority=40)

    def recording(self, path: Path, downscale: float) -> Recording:
        """Read the cameras and the headers of the images that fit ``downscale``."""
        shrunk, images = _image_folder(path, downscale)
        return _recording(path, images, shrunk)


def _image_folder(folder: Path, downscale: float) -> tuple[int, Path]:
    """By what the images were shrunk, and where they are: rgb/1x, rgb/2x, ...

    The smallest that are not smaller than asked for; else the largest that there are.
    """
    found = {
        int(item.name[:-1]): item
        for item in folder.glob("rgb/*x")
        if item.is_dir() and item.name[:-1].isdecimal() and int(item.name[:-1]) > 0
    }
    if not found:
        raise DataError(
            f"{folder} contains no images: there is no rgb/1x, rgb/2x, ...",
            "Copy the folder rgb, too.",
        )
    shrunk = max((factor for factor in found if factor <= downscale), default=min(found))
    return shrunk, found[shrunk]


def _recording(folder: Path, images: Path, shrunk: int) -> Recording:
    splits, split_notes = _splits(folder / "dataset.json")
    metadata = JsonFields.read(folder / "metadata.json")
    entries = {name: metadata.fields(name) for name in metadata.values}
    times = {
        name: entry.count(entry.first("time_id", "warp_id")) for name, entry in entries.items()
    }
    frames, missing = [], []
    for name, split in splits.items():
        image = _image(images, name)
        if image is None:
            missing.append(name)
            continue
        if name not in entries:
            raise DataError(
                f"{folder / 'metadata.json'} does not have {name}, which dataset.json lists.",
                "Copy both files from the same data set.",
            )
        frame = _frame(folder / "camera" / f"{name}.json", name, image)
        camera = entries[name].count("camera_id", default=0)
        frames.append(replace(frame, split=split, time=float(times[name]), camera=camera))
    missing_note = missing_images(missing, len(splits), images)
    (points, colors), point_note = _points(folder / "points.npy")
    return Recording(
        name=folder.resolve().name,
        path=folder,
        shrunk=shrunk,
        frames=tuple(frames),
        points=points,
        point_colors=colors,
        notes=(
            f"{folder / 'dataset.json'}: {len(splits)} frames, images of {images}"
            f" (1/{shrunk} of full size)",
            *split_notes,
            *missing_note,
            point_note,
        ),
        unused_times=tuple(float(time) for time in times.values()),
    )


def _splits(path: Path) -> tuple[dict[str, Split | None], tuple[str, ...]]:
    """The split of each frame that is used, and notes; ``None`` where nothing is held out."""
    content = JsonFields.read(path)
    all_names, train, evaluation = (content.texts(f"{of}ids", []) for of in ("", "train_", "val_"))
    train = train or all_names
    held = frozenset(evaluation)
    splits: dict[str, Split | None]
    if held:
        splits = {name: Split.TRAIN for name in train if name not in held}
        splits |= dict.fromkeys(evaluation, Split.EVAL)
    else:
        splits = dict.fromkeys(train)
    if not splits:
        raise DataError(f"{path} lists no frames.", "Expected train_ids and val_ids, or ids.")
    left_out = len(set(all_names) - set(splits))
    note = f"{left_out} frames are neither in train_ids nor in val_ids: left out"
    return splits, (note,) if left_out else ()


def _image(folder: Path, name: str) -> Path | None:
    candidates = (folder / f"{name}{end}" for end in EXTENSIONS)
    return next((path for path in candidates if is_file(path)), None)


def _frame(file: Path, name: str, image: Path) -> Frame:
    given = JsonFields.read(file)
    # Null stands for what is not given.
    known = {name: value for name, value in given.values.items() if value is not None}
    content = replace(given, values=known)
    orientation = torch.from_numpy(content.numbers("orientation", 3, 3))
    position = torch.from_numpy(content.numbers("position", 3))
    return Frame(
        name=name,
        path=image,
        header=read_header(image),
        lens=_lens(content),
        world_to_camera=pose_from_center(orientation, position, str(file)),
    )


def _lens(content: JsonFields) -> Lens:
    focal = content.number("focal_length")
    skew = content.number("skew", 0.0)
    cx, cy = content.numbers("principal_point", 2).tolist()
    width, height = content.numbers("image_size", 2).tolist()
    k1, k2, k3 = content.numbers("radial_distortion", 3, default=[0.0] * 3).tolist()
    tangential = content.first("tangential_distortion", "tangential")
    p1, p2 = content.numbers(tangential, 2, default=[0.0] * 2).tolist()
    if skew != 0:
        raise DataError(
            f"{content.at}: the camera is skewed (skew={skew:g}); expected 0.",
            "Calibrate it again without skew.",
        )
    lens = Lens(
        fx=focal,
        fy=focal * content.number("pixel_aspect_ratio", 1.0),
        cx=cx,
        cy=cy,
        width=round(width),
        height=round(height),
        source=content.at,
        model="FULL_OPENCV",
        distortion=(k1, k2, p1, p2, k3, 0.0, 0.0, 0.0),
    )
    lens.check()
    return lens


def _points(file: Path) -> tuple[Points, str]:
    """The points, grey since they have no colours, and a note on them."""
    if not file.is_file():
        return no_points(), f"there are no points (looked for {file.name})"
    advice = "Expected an array of the shape [points, 3]; remove it to train without points."
    try:
        points = torch.from_numpy(read_numbers(file))
    except DataError as error:
        raise DataError(f"{file} does not hold points: {error.message}", advice) from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise DataError(f"{file} does not hold points: its shape is {list(points.shape)}.", advice)
    return check_points(points, torch.full(points.shape, 0.5), file), f"{len(points)} points"
