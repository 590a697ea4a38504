"""VideoImages: images of videos in any order, decoded in order behind the scenes.

To reach an image all those since the key frame before it have to be decoded: on average 0.4 s
of a core for one of 100 images of 1088x1920 pixels between two key frames. So an image is
fetched that way when it is asked for first, and threads begin to decode its whole segment in order,
9 ms for each image; what they find is undistorted and shrunk as training uses it, and kept in a
temporary folder. From there an image comes in 1 to 2 ms.
"""

from __future__ import annotations

import os
import platform
import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Lock, Thread

import numpy as np
from jaxtyping import UInt8

from gsfw.core.cores import cores
from gsfw.core.errors import DataError
from gsfw.core.files.array_file import read_array
from gsfw.datamanagers.images import DecodedImage
from gsfw.datamanagers.video import Shot, Video

SHARE_OF_DISK = 0.9
"""Part of the free space when training begins; the rest is for checkpoints."""

FOLDERS = f"gsfw-video-{platform.node()}-"
"""Prefix of folder names, before the process; other machines may use the same disk."""

Segment = tuple[Video, range]


class VideoImages:
    """Decodes images of videos, and keeps them on disk until it is closed."""

    def __init__(
        self,
        shots: Mapping[int, Shot],
        sizes: Mapping[int, int],
        finish: Callable[[int, UInt8[np.ndarray, "h w 3"]], DecodedImage],
        room: int | None = None,
    ) -> None:
        """Nothing is decoded yet.

        Args:
            shots: the images, by the number that they are asked for with.
            sizes: bytes that each takes once it is finished.
            finish: makes of a decoded image what training uses; called from several threads.
            room: bytes on disk that may be used; ``None`` for most of what is free.
        """
        self._shots = shots
        self._sizes = sizes
        self._finish = finish
        self._wanted: dict[Path, dict[int, int]] = {}
        for index, shot in shots.items():
            self._wanted.setdefault(shot.video.path, {})[shot.number] = index
        self._needed = sum(sizes[index] for index in shots)
        free = shutil.disk_usage(tempfile.gettempdir()).free
        self._room = int(SHARE_OF_DISK * free) if room is None else room
        self._left = self._room
        self._lock = Lock()
        self._begun: set[tuple[Path, int]] = set()
        self._claimed: set[int] = set()
        self._kept: set[int] = set()
        self._shelf: _Shelf | None = None

    def notes(self) -> tuple[str, ...]:
        """Size and place of the kept images; a note if some are decoded again for lack of room."""
        if not self._shots:
            return ()
        needed, folder = self._needed / 1e6, tempfile.gettempdir()
        what = f"{len(self._shots)} images of {len(self._wanted)} videos"
        if self._needed <= self._room:
            return (f"{what}: decoded once and kept in {folder} while training ({needed:.0f} MB)",)
        return (
            f"{what}: {needed:.0f} MB once decoded, and {self._room / 1e6:.0f} MB to use in "
            f"{folder}; the others are decoded again for each use, which is slow (use a larger "
            "downscale, or name a folder with more room: TMPDIR=DIR)",
        )

    def get(self, index: int) -> DecodedImage:
        """An image; called from several threads.

        Raises:
            DataError: it does not decode.
        """
        if index in self._kept and self._shelf is not None:
            return self._shelf.load(index)
        shot = self._shots[index]
        self._begin(shot)
        image = self._finish(index, shot.video.image(shot.number))
        self._keep(index, image)
        return image

    def close(self) -> None:
        """Stop decoding, and remove what was kept."""
        with self._lock:
            shelf, self._shelf = self._shelf, None
            self._begun.clear()
            self._claimed.clear()
            self._kept.clear()
            self._left = self._room
        if shelf is not None:
            shelf.close()

    def _begin(self, shot: Shot) -> None:
        """Have the segment of an image decoded, unless that has begun or there is no room."""
        segment = shot.video.segment(shot.number)
        with self._lock:
            if (shot.video.path, segment.start) in self._begun or self._left <= 0:
                return
            self._begun.add((shot.video.path, segment.start))
            if self._shelf is None:
                try:
                    self._shelf = _Shelf(self._develop)
                except OSError:  # The disk is full, or cannot be written to.
                    self._left = 0
                    return
            self._shelf.segments.put((shot.video, segment))

    def _develop(self, video: Video, segment: range, closed: Event) -> None:
        """Decode a segment and keep what is used of it, as long as there is room."""
        wanted = self._wanted[video.path]
        last = max(number for number in segment if number in wanted)
        try:
            for number, pixels in video.images(range(segment.start, last + 1)):
                index = wanted.get(number)
                if closed.is_set() or self._left <= 0:
                    return
                if index is not None and index not in self._claimed:
                    self._keep(index, self._finish(index, pixels))
        except DataError:
            # Whoever asks for the image decodes it again, and gets the error.
            return

    def _keep(self, index: int, image: DecodedImage) -> None:
        """Put an image onto the shelf, if there is room and nobody else does."""
        with self._lock:
            shelf = self._shelf
            if shelf is None or index in self._claimed or self._sizes[index] > self._left:
                return
            self._left -= self._sizes[index]
            self._claimed.add(index)
        try:
            shelf.save(index, image)
        except OSError:  # The disk is full after all: others write to it, too.
            self._left = 0
            return
        with self._lock:
            if shelf is self._shelf:
                self._kept.add(index)


class _Shelf:
    """The folder of the images, and the threads that fill it."""

    def __init__(self, develop: Callable[[Video, range, Event], None]) -> None:
        """Start the threads: half as many as there are cores, so that training goes on.

        Raises:
            OSError: the folder cannot be made.
        """
        _sweep()
        self.folder = Path(tempfile.mkdtemp(prefix=f"{FOLDERS}{os.getpid()}-"))
        self.segments: SimpleQueue[Segment | None] = SimpleQueue()
        closed = Event()
        threads = [
            Thread(target=_work, args=(self.segments, develop, closed), daemon=True)
            for _ in range(max(1, min(4, cores() // 2)))
        ]
        for thread in threads:
            thread.start()
        # Also where nobody calls close(): threads must not run while the interpreter goes down.
        self.close = weakref.finalize(self, _clear, self.folder, self.segments, threads, closed)

    def save(self, index: int, image: DecodedImage) -> None:
        """Write an image, as uncompressed arrays.

        Raises:
            OSError: there is no room; nothing is left of it.
        """
        pixels, mask = self._files(index)
        try:
            if image.mask is not None:
                np.save(mask, image.mask)
            np.save(pixels, image.pixels)
        except OSError:
            for file in (pixels, mask):
                file.unlink(missing_ok=True)
            raise

    def load(self, index: int) -> DecodedImage:
        """Read an image."""
        pixels, mask = self._files(index)
        return DecodedImage(read_array(pixels), read_array(mask) if mask.exists() else None)

    def _files(self, index: int) -> tuple[Path, Path]:
        """Files of the pixels and of the mask."""
        return self.folder / f"{index}.npy", self.folder / f"{index}.mask.npy"


def _sweep() -> None:
    """Remove the folders of processes that were killed: nobody else will."""
    for folder in Path(tempfile.gettempdir()).glob("gsfw-video-*"):
        if folder.name.startswith(FOLDERS):
            process = folder.name.removeprefix(FOLDERS).partition("-")[0]
            if process.isdecimal() and not _is_alive(int(process)):
                shutil.rmtree(folder, ignore_errors=True)


def _is_alive(process: int) -> bool:
    """True if a process is at work, or may be: on Windows asking would end it."""
    if os.name == "nt":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # It is somebody else's, or no number of a process.
        return True
    return True


def _work(
    segments: SimpleQueue[Segment | None],
    develop: Callable[[Video, range, Event], None],
    closed: Event,
) -> None:
    """Decode segments in the order of their requests, until it is closed."""
    while (segment := segments.get()) is not None and not closed.is_set():
        develop(*segment, closed)


def _clear(
    folder: Path, segments: SimpleQueue[Segment | None], threads: list[Thread], closed: Event
) -> None:
    """Stop the threads, which takes as long as one image does, and remove the folder."""
    closed.set()
    for _ in threads:
        segments.put(None)
    for thread in threads:
        thread.join()
    shutil.rmtree(folder, ignore_errors=True)
