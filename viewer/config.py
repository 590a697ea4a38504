"""Settings of the viewer of a run, ``viewer.KEY=VALUE``; light to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gsfw.core.config import CallbackConfig
from gsfw.core.ranges import number

if TYPE_CHECKING:
    from gsfw.core.callback import Callback

PORT_KEY = "viewer.port"
"""The key of the port, for messages."""


@dataclass
class ViewerConfig(CallbackConfig):
    """The page of a run that trains."""

    enabled: bool = False
    """True to open a page on this machine that shows the run and can pause it (viewer=true)."""
    port: int = number(0, at_least=0, at_most=65535)
    """Port of the page; 0: the first free one from 8080."""
    share: float = number(0.2, above=0, below=1)
    """Largest part of the time that frames may take from training; none while paused."""

    def check(self) -> None:
        """Check that there can be a page.

        Raises:
            UnavailableError: viser is not installed.
            ConfigError: the port is taken, or may not be used.
        """
        from gsfw.viewer.server import bound, check_installed

        check_installed()
        bound(self.port, PORT_KEY).close()

    def build(self) -> Callback:
        """Build the callback."""
        from gsfw.viewer.training import TrainingViewer

        return TrainingViewer(self.port, self.share)
