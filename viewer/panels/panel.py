"""Panel: one part of the page's interface."""

from __future__ import annotations

from gsfw.viewer.frame import Frame


class Panel:
    """One part of the page's interface; built inside its tab."""

    def shown(self, frame: Frame) -> None:
        """Follow a frame that the page has got; runs in the viewport's thread."""

    def update(self) -> None:
        """Refresh figures, a few times a second."""
