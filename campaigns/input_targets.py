"""Targets: every reader of files that come from elsewhere, with sound files that it reads.

A new reader is one more entry here. Data managers and importers are found in the registry; a test
says so if a registered one has no sound files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from file_sets import FileSet
from sound_captures import CAPTURES
from sound_files import FILES
from sound_runs import RUN_FILES
from support.reader_faults import unsound
from support.readers_under_test import MODELS, Reader, readers

from gsfw.callbacks.event_files import cut_events
from gsfw.core.cameras import Cameras
from gsfw.core.config import DataManagerConfig
from gsfw.core.datamanager import DataManager, DataRequest, Split
from gsfw.core.files.array_file import read_array
from gsfw.core.files.folder_lock import Owner
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.datamanagers.calibration import read_calibration
from gsfw.datamanagers.capture_config import CaptureConfig
from gsfw.datamanagers.images import decode, decode_mask, decode_numbers, read_header
from gsfw.datamanagers.point_file import read_points
from gsfw.datamanagers.video import Video
from gsfw.editing.script import read_steps
from gsfw.plugins.config_file import read_config
from gsfw.plugins.loading import load_all
from gsfw.plugins.plugin_path import _entry_points
from gsfw.plugins.registry import installed
from gsfw.preparation.exif import read_exif
from gsfw.preparation.journal import Journal
from gsfw.preparation.writing.written_files import is_all_there
from gsfw.rendering.frame_folder import FrameFolder
from gsfw.rendering.path_files import read_path_file
from gsfw.reports.pictures import stored_pictures
from gsfw.reports.run_page import run_page
from gsfw.reports.run_reader import read_run
from gsfw.studies.bench.workload import read_workload
from gsfw.studies.result import ResultStore
from gsfw.studies.study_file import read_study

WITHOUT_FILES = {"synthetic"}
"""Data managers that read none."""
WRITING = {"run folder", "notes of a preparation", "frames of a film", "events"}
"""Readers that also write."""
SHARES = {MODELS: 15, "sog": 15, "gltf": 15, "usd": 1}
"""Shares of the slower importers; a process of its own reads each file of USD."""
DEEP, DEEPEST = 3, 9
"""Every third execution builds the cameras of a capture, every ninth decodes its images."""

Read = Callable[[Path, int], object]
"""Reads what is at a path all the way; the number of the execution says how deep to go."""


@dataclass(frozen=True)
class Target:
    """A reader, with sound files."""

    name: str
    read: Read
    write: Sequence[Callable[[Path], str]]
    """Writers of sound files: each fills a folder, and gives the path in it that is read."""
    share: int
    """Executions in proportion to those of the other targets: few where reading takes long."""
    check: Callable[[Any], str] = lambda _: ""
    """Says what is wrong with what was read."""
    writes: bool = False
    """True if it changes the files that it reads: they are written anew before each execution."""

    def sets(self, folder: Path) -> list[FileSet]:
        """The sound files, by way of an empty folder."""
        found = []
        for number, write in enumerate(self.write):
            place = folder / f"{number}"
            place.mkdir(parents=True)
            entry = write(place)
            found.append(FileSet.of(getattr(write, "__name__", f"{number}"), place, entry))
        return found


def targets(folder: Path) -> list[Target]:
    """All targets.

    Args:
        folder: an empty one, for sound files of splats.
    """
    return [*_datamanagers(), *_importers(folder), *_files(), *_runs()]


def _datamanagers() -> Iterator[Target]:
    kinds: Mapping[str, type[DataManagerConfig]] = load_all("datamanager", installed())
    for name, kind in kinds.items():
        if name in WITHOUT_FILES:
            continue
        writers = CAPTURES.get(name, ())
        share = 4 if name in ("neural-3d-video", "synchronised-videos") else 15
        yield Target(f"data {name}", partial(_read_capture, kind), writers, share, _capture)


def _read_capture(kind: type[DataManagerConfig], path: Path, number: int) -> DataManager | None:
    kind.detect(path)
    config = kind()
    if hasattr(config, "depth"):
        config.depth = True
    if number % DEEP and isinstance(config, CaptureConfig):
        config.recording(path, 1.0).read_sightings()
        return None
    data = config.build(DataRequest(path, eval_every_nth=2))
    try:
        data.notes()
        if number % DEEPEST == 0:
            for split in Split:
                views = range(len(data.views(split)))
                for batch in data.load(split, views, torch.device("cpu")):
                    assert 0 <= float(batch.images.min()) <= float(batch.images.max()) <= 1
                for index in views:
                    data.moving_mask(split, index)
        return data
    finally:
        data.close()


def _capture(data: DataManager | None) -> str:
    """Tell faults of the cameras and points of a data set."""
    if data is None:
        return ""
    scene = data.scene
    cameras: list[Cameras] = [c for split in Split for c in data.views(split).cameras]
    numbers = [scene.points, scene.point_colors, scene.camera_centers]
    numbers += [item for c in cameras for item in (c.world_to_camera, c.intrinsics)]
    if not all(bool(tensor.isfinite().all()) for tensor in numbers):
        return "its cameras or points are not finite"
    focal = [float(c.intrinsics[0, axis, axis]) for c in cameras for axis in (0, 1)]
    if min(focal) <= 0 or not 0 < scene.extent < float("inf"):
        return f"a focal length is {min(focal)}, or the extent is {scene.extent}"
    return ""


def _importers(folder: Path) -> Iterator[Target]:
    folder.mkdir(parents=True, exist_ok=True)
    for name, reader in readers(folder).items():
        writers = [partial(_write_sound, reader, n) for n in range(len(reader.sound))]
        share = SHARES.get(name, 40)
        yield Target(f"splats {name}", partial(_read_splats, reader), writers, share, unsound)


def _write_sound(reader: Reader, number: int, folder: Path) -> str:
    sound = reader.sound[number]
    return sound.write(folder, "sound").relative_to(folder).as_posix()


def _read_splats(reader: Reader, path: Path, number: int) -> object:
    reader.kind.recognises(path)
    return reader.kind().read(path)


def _files() -> Iterator[Target]:
    """Files that data sets are made of, each alone."""
    reads: Mapping[str, tuple[Read, int]] = {
        "points": (lambda path, _: read_points(path, "points"), 60),
        "image": (_read_image, 40),
        "mask": (lambda path, _: decode_mask(path), 30),
        "array": (lambda path, _: read_array(path), 60),
        "calibration": (lambda path, _: read_calibration(path), 60),
        "video": (_read_video, 4),
        "workload": (lambda path, _: read_workload(path), 15),
    }
    for name, (read, share) in reads.items():
        yield Target(name, read, FILES[name], share)


def _read_image(path: Path, number: int) -> object:
    read_exif(path)
    if number % 2:
        return decode_numbers(path)
    header = read_header(path)
    return decode(path, header, (8, 6) if number % DEEP == 0 else None)


def _read_video(path: Path, number: int) -> object:
    video = Video.read(path)
    video.check_even()
    return list(video.images(range(min(len(video), 100))))


def _runs() -> Iterator[Target]:
    """Files of gsfw itself."""
    reads: Mapping[str, tuple[Read, int]] = {
        "config": (lambda path, number: read_config(path, everything=number % 2 == 0), 30),
        "run folder": (_read_run, 8),
        "checkpoint": (lambda path, _: read_checkpoint(path), 20),
        "study": (lambda path, _: read_study(path), 15),
        "results of a study": (lambda path, _: ResultStore(path, "A study"), 60),
        "camera path": (lambda path, _: read_path_file(path), 30),
        "edits": (lambda path, _: read_steps(path), 60),
        "notes of a preparation": (_read_work, 40),
        "frames of a film": (_read_frames, 60),
        "package of a plugin": (_read_project, 60),
        "owner of a folder": (lambda path, _: Owner.read(path), 60),
        "events": (lambda path, _: cut_events(path, lambda step, tag: step < 3), 40),
    }
    for name, (read, share) in reads.items():
        yield Target(name, read, RUN_FILES[name], share, writes=name in WRITING)


def _read_run(path: Path, number: int) -> object:
    folder = RunFolder(path)
    page = run_page(read_run(folder), None, [])
    folder.cut_metrics_log(10, False)
    stored_pictures(folder)
    return page


def _read_work(path: Path, number: int) -> object:
    journal = Journal(path / "journal.json")
    journal.stage("match", {}, lambda: {"count": 3})
    return is_all_there(path), journal.seconds


def _read_frames(path: Path, number: int) -> object:
    same = FrameFolder(path, {}, ["0001.png"])
    kept = same.kept, same.scales
    FrameFolder(path, {"other": 1}, ["0001.png"]).start({})
    return kept


def _read_project(path: Path, number: int) -> object:
    try:
        return _entry_points(path)
    except ValueError as error:  # A sentence of the list of plugins.
        return str(error)
