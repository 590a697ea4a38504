"""Data sets of estimated cameras: images in images/, and a file of cameras in either layout."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64, UInt8

from gsfw.core.errors import DataError
from gsfw.core.files.atomic import write_atomically
from gsfw.core.progress import stage
from gsfw.datamanagers.images import decode, fit_mask, load_mask
from gsfw.datamanagers.lens import Lens
from gsfw.datamanagers.transforms_writer import FILE, POINTS_FILE
from gsfw.datamanagers.warp import MapCache
from gsfw.preparation.image_file import unique_names, with_right_suffix
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.writing.camera_plan import CameraPlan
from gsfw.preparation.writing.image_output import (
    ImageChange,
    OutputRule,
    StoredImage,
    encoded_mask,
)
from gsfw.preparation.writing.moved_model import (
    NO_POINT,
    Sightings,
    lens_of_camera,
    moved_model,
)
from gsfw.preparation.writing.timed_cameras import model_to_transforms
from gsfw.preparation.writing.worker_threads import in_order, workers_for
from gsfw.preparation.writing.written_files import (
    COLMAP,
    IMAGES,
    MASKS,
    TRANSFORMS,
    WrittenDataSet,
    check_sources_stay,
    place_model,
    start_over,
)

if TYPE_CHECKING:
    from pycolmap import Image, Reconstruction


@dataclass(frozen=True)
class _Task:
    """An image that is to be written."""

    number: int
    """Number of its image in the model."""
    image: SourceImage
    change: ImageChange
    seen: Sightings
    name: str

    @property
    def has_mask(self) -> bool:
        """True if some pixels of the written image do not count."""
        return self.has_blanks or self.image.mask is not None

    @property
    def has_blanks(self) -> bool:
        """True if the lens did not see all of the written image."""
        undistortion = self.change.plan.undistortion
        return undistortion is not None and undistortion.has_blanks


@dataclass(frozen=True)
class _Made:
    """Output content of an image, and its colours at the observed points."""

    content: bytes
    mask: bytes | None
    points: Float64[np.ndarray, "m 3"]


def write_data_set(
    model: Reconstruction,
    images: ImageSet,
    out: Path,
    rule: OutputRule,
    jobs: int = 1,
    layout: str = COLMAP,
) -> WrittenDataSet:
    """Write images and cameras; these come last, so that with them a data set is complete.

    Every run writes all images: points get their colours, and none of another estimate stays.

    Args:
        model: estimated cameras and points; only registered images are written.
        images: holds every image of the model, by name.
        out: the folder of images/, masks/ (where some pixels do not count) and cameras.
        rule: what becomes of lenses and files.
        jobs: how many images are worked on at a time, where memory allows it.
        layout: ``COLMAP`` or ``TRANSFORMS``.

    Raises:
        DataError: a lens cannot be undistorted.
        OutputError: something cannot be written, or would be written over what is read.
    """
    tasks = _tasks(model, images, rule)
    _make_room(tasks, out, layout)
    colors = _MeanColors(model)
    size = 0
    with (
        stage("images", len(tasks)) as advance,
        closing(_made(tasks, rule, jobs)) as results,
    ):
        for done, (task, made) in enumerate(zip(tasks, results, strict=True), 1):
            write_atomically(out / IMAGES / task.name, made.content)
            if made.mask is not None:
                write_atomically(out / MASKS / f"{task.name}.png", made.mask)
            size += len(made.content) + len(made.mask or b"")
            colors.add(task.seen, made.points)
            advance(done)
    moved = moved_model(
        model,
        {model.images[task.number].camera_id: task.change.plan for task in tasks},
        {task.number: task.name for task in tasks},
        {task.number: task.seen for task in tasks},
        colors.result(),
    )
    cameras = place_model(moved.write_binary, len(tasks), moved.num_points3D(), out)
    if layout == TRANSFORMS:
        cameras = model_to_transforms(out, _times(tasks))
    return _written(model, moved, tasks, size + cameras, layout)


def _plan(lens: Lens, keep: bool) -> CameraPlan:
    try:
        return CameraPlan.of(lens, keep)
    except DataError as error:
        raise DataError(
            error.message,
            "Compute it with fewer parameters (camera_model=SIMPLE_RADIAL), from more images "
            "(cameras=one), or leave images as they are (lens=keep).",
        ) from error


def _times(tasks: Sequence[_Task]) -> dict[str, float]:
    """Seconds by name of the image; none where a photo, which has no time, is among them."""
    times = {task.name: task.image.time for task in tasks}
    found = {name: time for name, time in times.items() if time is not None}
    return found if len(found) == len(tasks) else {}


def _make_room(tasks: Sequence[_Task], out: Path, layout: str) -> None:
    """Check that nothing is in the way that is read, and remove what an earlier run has left."""
    targets = [f"{IMAGES}/{task.name}" for task in tasks]
    targets += [FILE, POINTS_FILE] if layout == TRANSFORMS else []
    check_sources_stay([task.image.path for task in tasks], [out / name for name in targets])
    start_over(out, [*targets, *(f"{MASKS}/{task.name}.png" for task in tasks if task.has_mask)])


def _tasks(model: Reconstruction, images: ImageSet, rule: OutputRule) -> list[_Task]:
    """One for each registered image, in the order of their names."""
    registered = sorted((model.images[number] for number in model.reg_image_ids()), key=_name)
    own = [images.by_name[image.name] for image in registered]
    stored = [StoredImage.read(one.path, one.header) for one in own]
    keep = rule.lens == "keep"
    plans = {
        number: _plan(lens_of_camera(model.cameras[number], number), keep)
        for number in sorted({image.camera_id for image in registered})
    }
    changes = [
        ImageChange(file, plans[image.camera_id])
        for image, file in zip(registered, stored, strict=True)
    ]
    names = unique_names(
        with_right_suffix(image.name, change.format)
        for image, change in zip(registered, changes, strict=True)
    )
    return [
        _Task(image.image_id, source, change, Sightings.of(image), name)
        for image, source, change, name in zip(registered, own, changes, names, strict=True)
    ]


def _name(image: Image) -> str:
    return str(image.name)


def _made(tasks: Sequence[_Task], rule: OutputRule, jobs: int) -> Generator[_Made, None, None]:
    """The output contents in order, made by several threads."""
    maps = MapCache()
    work = partial(_make, maps=maps, quality=rule.jpeg_quality)
    return in_order(work, tasks, workers_for((task.image.header for task in tasks), jobs))


def _make(task: _Task, maps: MapCache, quality: int) -> _Made:
    """Decode an image once: for the colours of its points, and for what is written of it."""
    pixels = decode(task.image.path, task.image.header)
    warp = task.change.warp(maps)
    source, target = task.image, task.change.plan.target
    inside = None if source.mask is None else load_mask(source.mask, source.path, source.header)
    mask = fit_mask(inside, target.width, target.height, warp)
    return _Made(
        task.change.content(lambda: pixels, warp, quality),
        None if mask is None else encoded_mask(mask),
        _sampled(pixels, task.seen.pixels[task.seen.points != NO_POINT]),
    )


def _sampled(
    pixels: UInt8[np.ndarray, "h w d"], places: Float64[np.ndarray, "m 2"]
) -> Float64[np.ndarray, "m 3"]:
    """Colours between pixel centres, which lie at halves; beyond the outermost, theirs."""
    last = np.array([pixels.shape[1], pixels.shape[0]]) - 1
    inside = (places - 0.5).clip(0, last)
    first = np.minimum(inside.astype(np.int64), np.maximum(last - 1, 0))
    second = np.minimum(first + 1, last)
    right, down = (inside - first).T[..., None]
    (x0, y0), (x1, y1) = first.T, second.T
    upper = pixels[y0, x0, :3] * (1 - right) + pixels[y0, x1, :3] * right
    lower = pixels[y1, x0, :3] * (1 - right) + pixels[y1, x1, :3] * right
    colors: Float64[np.ndarray, "m 3"] = upper * (1 - down) + lower * down
    return colors


class _MeanColors:
    """The mean colour of each point over the images that see it."""

    def __init__(self, model: Reconstruction) -> None:
        """Nothing is seen yet."""
        self._ids = np.array(sorted(model.point3D_ids()), np.int64)
        self._sums = np.zeros((len(self._ids), 3))
        self._counts = np.zeros(len(self._ids), np.int64)

    def add(self, seen: Sightings, colors: Float64[np.ndarray, "m 3"]) -> None:
        """Colours of the points that one image has seen."""
        rows = np.searchsorted(self._ids, seen.points[seen.points != NO_POINT])
        np.add.at(self._sums, rows, colors)
        np.add.at(self._counts, rows, 1)

    def result(self) -> dict[int, UInt8[np.ndarray, " 3"]]:
        """By the number of the point; black where no image sees it."""
        means = self._sums / np.maximum(self._counts, 1)[:, None]
        rounded = np.rint(means).clip(0, 255).astype(np.uint8)
        return dict(zip(self._ids.tolist(), rounded, strict=True))


def _is_turned(change: ImageChange) -> bool:
    return change.stored is not None and change.stored.is_turned


def _written(
    model: Reconstruction, moved: Reconstruction, tasks: Sequence[_Task], size: int, layout: str
) -> WrittenDataSet:
    return WrittenDataSet.of(
        layout,
        [task.change.plan for task in tasks],
        masks=sum(task.has_mask for task in tasks),
        points=moved.num_points3D(),
        size=size,
        notes=(*_notes(model, moved, tasks), *_notes_on_times(tasks, layout)),
    )


def _notes(model: Reconstruction, moved: Reconstruction, tasks: Sequence[_Task]) -> Iterator[str]:
    renamed = [task for task in tasks if task.name != task.image.name]
    if renamed:
        first = renamed[0]
        yield (
            f"{first.image.name} is named {first.name}, which fits its format"
            f"{f' ({len(renamed)} images have another name)' if renamed[1:] else ''}"
        )
    turned = sum(_is_turned(task.change) for task in tasks)
    if turned:
        yield f"images that only an EXIF tag turned are stored upright: {turned}"
    if any(task.has_blanks for task in tasks):
        yield f"{MASKS}/ marks what lenses did not see"
    lost = model.num_points3D() - moved.num_points3D()
    if lost:
        yield f"{lost} points, which fewer than two undistorted images show, are left out"


def _notes_on_times(tasks: Sequence[_Task], layout: str) -> Iterator[str]:
    videos = {task.image.group for task in tasks if task.image.time is not None}
    if layout == COLMAP:
        if _times(tasks):
            yield "if the scene moves, layout=transforms keeps the time of each frame for training"
    elif not _times(tasks):
        beside = ", and frames of videos beside them lose theirs" if videos else ""
        yield f"photos have no times{beside}: methods for moving scenes need frames of videos alone"
    elif len(videos) > 1:
        yield (
            f"the times of {len(videos)} videos are seconds from the first image of each: motion "
            "fits together only if all of them began at the same moment"
        )
