"""Workspace: the folder of a prepared data set, and what is kept of the work on it."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from gsfw.core.errors import OutputError
from gsfw.core.files.atomic import readable_write_errors, without_new_folders
from gsfw.core.files.folder_lock import CLAIM, LOCK, only_one
from gsfw.core.files.prepared_folder import JOURNAL, REPORT
from gsfw.core.files.reading import followed

OTHERS = "another gsfw prepare"


@dataclass(frozen=True)
class Workspace:
    """Paths of a preparation, below one folder."""

    path: Path
    attempt: str = ""
    """Name of an attempt at the cameras that has a database and models of its own, beside those of
    the first."""

    @property
    def images(self) -> Path:
        """Images of the data set."""
        return self.path / "images"

    @property
    def sparse(self) -> Path:
        """The folder of its model."""
        return self.path / "sparse"

    @property
    def report(self) -> Path:
        """The report for programs."""
        return self.path / REPORT

    @property
    def sheet(self) -> Path:
        """The contact sheet."""
        return self.path / "prepare.png"

    @property
    def work(self) -> Path:
        """State for resuming the same command; not needed to train."""
        return self.path / "work"

    @property
    def journal(self) -> Path:
        """The finished stages."""
        return self.path / JOURNAL

    @property
    def frames(self) -> Path:
        """Frames that were taken from videos."""
        return self.work / "frames"

    @property
    def photos(self) -> Path:
        """JPEG files of HEIC and AVIF photos."""
        return self.work / "photos"

    @property
    def views(self) -> Path:
        """Views that were cut from panoramas."""
        return self.work / "views"

    @property
    def database(self) -> Path:
        """COLMAP's features and matches."""
        return self.attempt_folder / "database.db"

    @property
    def models(self) -> Path:
        """COLMAP's models of the distorted images."""
        return self.attempt_folder / "models"

    @property
    def attempt_folder(self) -> Path:
        """Database and models of an attempt at the cameras."""
        return self.work / self.attempt

    @property
    def thorough(self) -> Workspace:
        """The same folder, with an attempt that looks for the finest features."""
        return Workspace(self.path, "thorough")

    @property
    def log(self) -> Path:
        """COLMAP's log."""
        return self.work / "log"

    @contextmanager
    def claimed(self, inputs: tuple[Path, ...]) -> Iterator[None]:
        """Take the folder, and keep it from others; after an error nothing new and empty is left.

        Raises:
            OutputError: it holds something else or an input, is in use, or cannot be written to.
        """
        self._check_apart(inputs)
        with readable_write_errors(self.path):
            held = sorted(self.path.iterdir()) if self.path.is_dir() else []
        if held == [self.work] and self.work.is_dir() and not any(self.work.iterdir()):
            held = []  # All that a preparation leaves that is killed at once.
        # Users may remove work/, and have one of their own where they have never been.
        if held and not ((self.work / LOCK).is_file() or self.report.is_file()):
            raise OutputError(
                f"out={self.path} is not empty, and not a folder of gsfw prepare "
                f"(it holds {held[0].name}{' and more' if len(held) > 1 else ''}).",
                "Give a new folder; nothing in this one was touched.",
            )
        is_new = not self.work.exists()
        with without_new_folders(self.work), only_one(self.work, OTHERS):
            try:
                yield
            except BaseException:
                if is_new:
                    self._remove_traces()
                raise

    def _remove_traces(self) -> None:
        """Remove the lock and the log, if there is nothing else: no input was accepted.

        The lock is held meanwhile, so that no other program takes it.
        """
        with suppress(OSError):
            if {item.name for item in self.work.iterdir()} <= {LOCK, CLAIM, self.log.name}:
                shutil.rmtree(self.log, ignore_errors=True)
                for name in (LOCK, CLAIM):
                    (self.work / name).unlink(missing_ok=True)

    def _check_apart(self, inputs: tuple[Path, ...]) -> None:
        """Check that no input lies where the result will be written.

        Raises:
            OutputError: one does.
        """
        out = followed(self.path)
        for given in inputs:
            source = followed(given)
            if out == source or out in source.parents:
                raise OutputError(
                    f"out={self.path} holds {given}, which the result is made from.",
                    "Give a folder of its own: what is there already stays as it is.",
                )

    def remove(self, *paths: Path) -> None:
        """Remove files and folders that stages have left.

        Raises:
            OutputError: they cannot be removed.
        """
        for path in paths:
            with readable_write_errors(path):
                if path.is_dir():
                    shutil.rmtree(path)
                else:
                    path.unlink(missing_ok=True)
