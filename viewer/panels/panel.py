"""Panel: one part of the page's interface."""

from __future__ import annotations

from abc import ABC

from gsfw.viewer.frame import Frame


class Panel(ABC):
    """One part of the page's interface; built inside its tab."""

    def shown(self, frame: Frame) -> None:  # noqa: B027
        """Follow a frame that the page has got; runs in the viewport's thread."""

    def update(self) -> None:  # noqa: B027
        """Refresh figures, a few times a second."""
