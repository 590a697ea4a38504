"""Session: everything that the pages of one viewer share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
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
    live: LiveRun | None = None
    """The run that trains; ``None`` for a finished one and for files."""
    service: FrameService = field(init=False)
    first: FirstView = field(init=False)

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
        return " | ".join(model.name for model in self.models)


def serve(session: Session, until: Callable[[], bool]) -> None:
    """Serve pages on this thread until ``until`` is true."""
    while not until():
        if not session.service.serve_one():
            session.service.wait()
