"""Conversion: a data set with poses, of any format, written in one that other programs read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from gsfw.core.files.atomic import write_atomically
from gsfw.core.progress import stage
from gsfw.datamanagers.colmap.writer import write_model
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.map_file import DEPTH
from gsfw.datamanagers.masks import USUAL_MASKS, MaskRule, find_masks
from gsfw.datamanagers.transforms_writer import FILE, POINTS_FILE, write_transforms
from gsfw.datamanagers.warp import MapCache
from gsfw.preparation.writing.conversion_notes import SPLIT_LIST, conversion_notes, write_split_list
from gsfw.preparation.writing.converted_frame import FrameTask, tasks_of
from gsfw.preparation.writing.image_output import OutputRule
from gsfw.preparation.writing.worker_threads import in_order, workers_for
from gsfw.preparation.writing.written_files import (
    COLMAP,
    TRANSFORMS,
    WrittenDataSet,
    check_sources_stay,
    place_model,
    start_over,
)

AS_GIVEN = OutputRule("keep")


@dataclass(frozen=True)
class ConversionRule:
    """The target of a conversion."""

    layout: Literal["auto", "colmap", "transforms"] = "auto"
    """colmap, transforms, or auto: transforms where there are times or depths, else colmap."""
    output: OutputRule = AS_GIVEN
    """Treatment of lenses and images."""
    masks: MaskRule = USUAL_MASKS
    """The masks of the data; written masks are bright where pixels count."""

    def layout_of(self, frames: Sequence[Frame]) -> str:
        """Either colmap or transforms."""
        if self.layout != "auto":
            return self.layout
        needs_more = any(frame.time is not None or DEPTH in frame.maps for frame in frames)
        return TRANSFORMS if needs_more else COLMAP


def convert(recording: Recording, out: Path, rule: ConversionRule, jobs: int = 1) -> WrittenDataSet:
    """Write a data set's images, masks and depths, then its cameras and points.

    Args:
        recording: what a format's file says, as ``Capture.recording`` has it.
        out: the folder that images/, masks/ and so on are written to.
        rule: what it is converted to.
        jobs: how many images are worked on at a time, where memory allows it.

    Raises:
        DataError: an image, mask or depth map cannot be used, or a lens cannot be undistorted.
        OutputError: something cannot be written, or would be written over what is read.
    """
    by_name = sorted(recording.frames, key=lambda frame: frame.name)
    frames, _ = find_masks(recording, by_name, rule.masks)
    layout = rule.layout_of(frames)
    tasks = tasks_of(frames, rule.masks, rule.output.lens == "keep", layout == TRANSFORMS)
    names = [name for task in tasks for name in task.files.values()]
    check_sources_stay([path for task in tasks for path in task.sources], [out / n for n in names])
    start_over(out, [*names, FILE, POINTS_FILE, SPLIT_LIST])
    size = _write_files(tasks, out, rule.output.jpeg_quality, jobs)
    written = replace(recording, frames=tuple(task.written_frame(out) for task in tasks))
    size += _write_cameras(written, layout, out)
    return _converted(recording, written, tasks, layout, size, out)


def _write_files(tasks: Sequence[FrameTask], out: Path, quality: int, jobs: int) -> int:
    """Write what belongs to each image, worked on by several threads.

    Returns:
        Bytes written.
    """
    work = partial(_made, maps=MapCache(), quality=quality)
    workers = workers_for((task.frame.header for task in tasks), jobs)
    results = in_order(work, _decoded(tasks), workers)
    size = 0
    with stage("images", len(tasks)) as advance, closing(results):
        for done, files in enumerate(results, 1):
            for name, content in files.items():
                write_atomically(out / name, content)
                size += len(content)
            advance(done)
    return size


def _decoded(tasks: Sequence[FrameTask]) -> Iterator[FrameTask]:
    """The tasks, with the images of those of videos, which are decoded in order."""
    videos: dict[Path, dict[int, FrameTask]] = {}
    for task in tasks:
        if task.frame.shot is None:
            yield task
        else:
            videos.setdefault(task.frame.path, {})[task.frame.shot.number] = task
    for own in videos.values():
        shot = next(iter(own.values())).frame.shot
        assert shot is not None
        for number, pixels in shot.video.images(range(min(own), max(own) + 1)):
            if number in own:
                yield replace(own[number], pixels=pixels)


def _made(task: FrameTask, maps: MapCache, quality: int) -> dict[str, bytes]:
    return task.made(maps, quality)


def _write_cameras(written: Recording, layout: str, out: Path) -> int:
    if layout == TRANSFORMS:
        return write_transforms(written, out)
    write = partial(write_model, written, image_root=out / "images")
    size = place_model(write, len(written.frames), len(written.points), out)
    return size + write_split_list(written, out)


def _converted(
    recording: Recording,
    written: Recording,
    tasks: Sequence[FrameTask],
    layout: str,
    size: int,
    out: Path,
) -> WrittenDataSet:
    return WrittenDataSet.of(
        layout,
        [task.change.plan for task in tasks],
        masks=sum(frame.mask is not None for frame in written.frames),
        points=len(written.points),
        size=size,
        notes=conversion_notes(recording, written, layout, out),
    )
