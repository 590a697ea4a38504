"""Session: everything that the pages of one viewer share."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from gsfw.viewer.first_view import FirstView, first_view
from gsfw.viewer.frame_service import FrameService
from gsfw.viewer.viewed_model import ViewedModel

if TYPE_CHECKING:
    from gsfw.viewer.live_run import LiveRun


@dataclass
class Session:
    """Everything that the pages of one viewer share."""

    models: tuple[ViewedModel, ...]
    """One model, or two to compare; the first one's cameras and times are those of the page."""
    folder: Path
    """Folder of the files that pages order."""
    source: str
    """The run or file as other commands take it."""
    live: LiveRun | None = None
    """The run that trains; ``None`` for a finished one and for files."""
    service: FrameService = field(init=False)
    first: FirstView = field(init=False)

    _given: set[Path] = field(default_factory=set, init=False)
    """Paths of files that are not written yet."""
    _giving: threading.Lock = field(default_factory=threading.Lock, init=False)

    def __post_init__(self) -> None:
        self.service = FrameService(self.models)
        self.first = first_view(self.models[0])

    @property
    def model(self) -> ViewedModel:
        """The model whose cameras and times the page has."""
        return self.models[0]

    @property
    def title(self) -> str:
        """Title of the page."""
        return " | ".join(self.names)

    @property
    def names(self) -> list[str]:
        """Names of the models, such as "3dgs on fox", where these are all different.

        Else those of their files or folders, or the whole paths.
        """
        subjects = [model.subject for model in self.models]
        if all(subjects) and len(set(subjects)) == len(subjects):
            return subjects
        short = [PurePath(model.name).name or model.name for model in self.models]
        return short if len(set(short)) == len(short) else [model.name for model in self.models]

    def free_path(self, folder: str, name: str, *suffixes: str) -> Path:
        """A path of a new file, without its suffix: no file of these suffixes has it.

        Args:
            folder: below the folder of the session; it is made.
            name: wish of a page; it cannot lead elsewhere. Where it is taken, a number follows it.
            suffixes: that the file may get.
        """
        stem = "".join(c if c.isalnum() or c in "-_" else "-" for c in name) or "file"
        parent = self.folder / folder
        parent.mkdir(parents=True, exist_ok=True)
        with self._giving:
            for end in itertools.chain([""], map("_{}".format, itertools.count(2))):
                path = parent / f"{stem}{end}"
                files = (parent / f"{path.name}{suffix}" for suffix in suffixes)
                if path not in self._given and not any(file.exists() for file in files):
                    self._given.add(path)
                    return path
        raise AssertionError("numbers do not end")


def serve(session: Session, until: Callable[[], bool]) -> None:
    """Serve pages on this thread until ``until`` is true."""
    while not until():
        if not session.service.serve_one():
            session.service.wait()
