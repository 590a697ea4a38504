"""CameraFrusta: the cameras of the capture, drawn in the scene of one page, to click."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from gsfw.core.datamanager import Split, spread
from gsfw.viewer.session import Session
from gsfw.viewer.view_state import CapturedView, Pose

if TYPE_CHECKING:
    import viser

MOST = 250
"""Frusta drawn at most, evenly spread: more hide the scene, and slow down the page."""
COLORS = {Split.TRAIN: (74, 155, 224), Split.EVAL: (240, 160, 60)}
"""Colours of cameras that are trained on, and of those held out."""
SIZE = 0.04
"""Length of a frustum, relative to the size of the scene."""


class CameraFrusta:
    """Frusta of the captured views; hidden at first."""

    def __init__(
        self,
        client: viser.ClientHandle,
        session: Session,
        views: Sequence[CapturedView],
        clicked: Callable[[CapturedView], None],
    ) -> None:
        """Draw nothing yet.

        Args:
            client: the page.
            session: has the cameras.
            views: the captured views.
            clicked: called with a view whose frustum is clicked.
        """
        self._client, self._session, self._clicked = client, session, clicked
        self._views = [views[index] for index in spread(range(len(views)), MOST)]
        self._handles: list[viser.CameraFrustumHandle] = []

    def show(self, visible: bool) -> None:
        """Show or hide them; they are made when they are shown for the first time."""
        if visible and not self._handles:
            self._make()
        with self._client.atomic():
            for handle in self._handles:
                handle.visible = visible

    def resize(self, factor: float) -> None:
        """Draw them at this multiple of the usual size."""
        for handle in self._handles:
            handle.scale = self._scale * factor

    @property
    def _scale(self) -> float:
        return SIZE * self._session.first.size

    def _make(self) -> None:
        with self._client.atomic():
            for number, view in enumerate(self._views):
                camera = self._session.model.camera(view)
                pose = Pose.of(camera)
                handle = self._client.scene.add_camera_frustum(
                    f"/cameras/{number}",
                    fov=pose.fov,
                    aspect=camera.width / camera.height,
                    scale=self._scale,
                    thickness=2.0,
                    thickness_units="screen",
                    color=COLORS[view.split],
                    wxyz=pose.wxyz,
                    position=pose.position,
                    cast_shadow=False,
                    receive_shadow=False,
                    variant="wireframe",
                )
                handle.on_click(self._click_of(view))
                self._handles.append(handle)

    def _click_of(self, view: CapturedView) -> Callable[[object], None]:
        return lambda _: self._clicked(view)
