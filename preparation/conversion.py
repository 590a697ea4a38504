"""Conversion: a data set with poses, of any format, written in one that other programs read."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from gsfw.core.errors import ConfigError
from gsfw.core.run_folder import write_atomically
from gsfw.datamanagers.colmap.writer import write_model
from gsfw.datamanagers.frames import Frame, Recording
from gsfw.datamanagers.masks import USUAL_MASKS, MaskRule, find_masks
from gsfw.datamanagers.transforms_writer import FILE, POINTS_FILE, write_transforms
from gsfw.datamanagers.warp import MapCache
from gsfw.preparation.camera_plan import CameraPlan, OutputRule, lens_words
from gsfw.preparation.conversion_notes import SPLIT_LIST, conversion_notes, write_split_list
from gsfw.preparation.converted_frame import FrameJob, jobs_of
from gsfw.preparation.progress import Progress
from gsfw.preparation.worker_threads import in_order, workers_for
from gsfw.preparation.written_files import check_sources_stay, place_model, start_over

LAYOUTS = ("auto", "colmap", "transforms")
AS_GIVEN = OutputRule("keep")


@dataclass(frozen=True)
class ConversionRule:
    """What a data set is converted to."""

    layout: str = "auto"
    """colmap, transforms, or auto: transforms where there are times or depths, else colmap."""
    output: OutputRule = AS_GIVEN
    """What becomes of lenses and pictures."""
    masks: MaskRule = USUAL_MASKS
    """Which masks there are; written masks are bright where pixels count."""

    def check(self) -> None:
        """Check the values.

        Raises:
            ConfigError: one of them makes no sense.
        """
        self.output.check()
        if self.layout not in LAYOUTS:
            raise ConfigError(f"layout={self.layout}: expected {', '.join(LAYOUTS)}.")

    def layout_of(self, frames: Sequence[Frame]) -> str:
        """Either colmap or transforms."""
        if self.layout != "auto":
            return self.layout
        needs_more = any(frame.time is not None or frame.depth is not None for frame in frames)
        return "transforms" if needs_more else "colmap"


@dataclass(frozen=True)
class Converted:
    """What was written."""

    layout: str
    """colmap or transforms."""
    pictures: int
    masks: int
    points: int
    sizes: tuple[tuple[int, int], ...]
    """Width and height of the written pictures, the most frequent first."""
    lens: str
    """What became of the lenses, in words."""
    bytes: int
    """Of all files."""
    notes: tuple[str, ...] = ()
    """What the layout cannot hold, and what else its user should know."""


def convert(recording: Recording, out: Path, rule: ConversionRule, progress: Progress) -> Converted:
    """Write a data set's pictures, masks and depths, then its cameras and points.

    Args:
        recording: what a format's file says, as ``Capture.recording`` has it.
        out: the folder that images/, masks/ and so on are written to.
        rule: what it is converted to.
        progress: gets the stage "pictures".

    Raises:
        DataError: a picture, mask or depth map cannot be used, or a lens cannot be undistorted.
        OutputError: something cannot be written, or would be written over what is read.
    """
    by_name = sorted(recording.frames, key=lambda frame: frame.name)
    frames, _ = find_masks(recording, by_name, rule.masks)
    layout = rule.layout_of(frames)
    jobs = jobs_of(frames, rule.masks, rule.output.lens == "keep", layout == "transforms")
    names = [name for job in jobs for name in job.files.values()]
    check_sources_stay([path for job in jobs for path in job.sources], [out / n for n in names])
    start_over(out, [*names, FILE, POINTS_FILE, SPLIT_LIST])
    size = _write_files(jobs, out, rule.output.jpeg_quality, progress)
    written = replace(recording, frames=tuple(job.written_frame(out) for job in jobs))
    size += _write_cameras(written, layout, out)
    return _converted(recording, written, jobs, layout, size, out)


def _write_files(jobs: Sequence[FrameJob], out: Path, quality: int, progress: Progress) -> int:
    """Write what belongs to each picture, worked on by several threads.

    Returns:
        Bytes written.
    """
    work = partial(_made, maps=MapCache(), quality=quality)
    workers = workers_for(max(job.frame.header.width * job.frame.header.height for job in jobs))
    results = in_order(work, _decoded(jobs), workers)
    size = 0
    with progress.stage("pictures", len(jobs)) as advance, closing(results):
        for done, files in enumerate(results, 1):
            for name, content in files.items():
                write_atomically(out / name, content)
                size += len(content)
            advance(done)
    return size


def _decoded(jobs: Sequence[FrameJob]) -> Iterator[FrameJob]:
    """The jobs, with the pictures of those of videos, which are decoded in order."""
    videos: dict[Path, dict[int, FrameJob]] = {}
    for job in jobs:
        if job.frame.shot is None:
            yield job
        else:
            videos.setdefault(job.frame.path, {})[job.frame.shot.number] = job
    for own in videos.values():
        shot = next(iter(own.values())).frame.shot
        assert shot is not None
        for number, pixels in shot.video.pictures(range(min(own), max(own) + 1)):
            if number in own:
                yield replace(own[number], pixels=pixels)


def _made(job: FrameJob, maps: MapCache, quality: int) -> dict[str, bytes]:
    return job.made(maps, quality)


def _write_cameras(written: Recording, layout: str, out: Path) -> int:
    if layout == "transforms":
        return write_transforms(written, out)
    write = partial(write_model, written, pictures=out / "images")
    size = place_model(write, len(written.frames), len(written.points), out)
    return size + write_split_list(written, out)


def _converted(
    recording: Recording,
    written: Recording,
    jobs: Sequence[FrameJob],
    layout: str,
    size: int,
    out: Path,
) -> Converted:
    plans: list[CameraPlan] = [job.change.plan for job in jobs]
    sizes = Counter((plan.target.width, plan.target.height) for plan in plans)
    return Converted(
        layout=layout,
        pictures=len(jobs),
        masks=sum(frame.mask is not None for frame in written.frames),
        points=len(written.points),
        sizes=tuple(found for found, _ in sizes.most_common()),
        lens=lens_words(plans),
        bytes=size,
        notes=conversion_notes(recording, written, layout, out),
    )
