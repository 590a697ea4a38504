"""CameraFrusta: the cameras of the capture, drawn in the scene of one page, to click."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from gsfw.core.datamanager import Split, spread
from gsfw.viewer.session import Session
from gsfw.viewer.view_state import CapturedView, Pose, Vector

if TYPE_CHECKING:
    import viser

MOST = 250
"""Frusta drawn at most, evenly spread: more hide the scene, and slow down the page."""
COLORS = {Split.TRAIN: (74, 155, 224), Split.EVAL: (240, 160, 60)}
"""Colours of cameras that are trained on, and of those held out."""
SIZE = 0.02
"""Size of a frustum, relative to that of the scene; it is about 2.5 times as long and wide."""


NEAR = 16.0
"""A camera is drawn from this distance on, in sizes of its frustum: then it is as wide as a fifth
of the page at most."""


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
        self._places = np.zeros((0, 3))
        self._wanted, self._factor = False, 1.0
        self._position: Vector = session.first.pose.position

    def show(self, visible: bool) -> None:
        """Show or hide them; they are made when they are shown for the first time."""
        if visible and not self._handles:
            self._make()
        self._wanted = visible
        self._update()

    def resize(self, factor: float) -> None:
        """Draw them at this multiple of the usual size."""
        self._factor = factor
        for handle in self._handles:
            handle.scale = self._scale * factor
        self._update()

    def seen_from(self, position: Vector) -> None:
        """Hide those so near to the page's camera that their lines would cross the page."""
        self._position = position
        if self._wanted:
            self._update()

    def _update(self) -> None:
        """Tell the page what has changed."""
        if not self._handles:
            return
        distances = np.linalg.norm(self._places - np.asarray(self._position), axis=1)
        visible = self._wanted & (distances > NEAR * self._scale * self._factor)
        with self._client.atomic():
            for handle, shown in zip(self._handles, visible.tolist(), strict=True):
                if handle.visible != shown:
                    handle.visible = shown

    @property
    def _scale(self) -> float:
        return SIZE * self._session.first.size

    def _make(self) -> None:
        handles, places = [], []
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
                handles.append(handle)
                places.append(pose.position)
        self._places, self._handles = np.asarray(places), handles

    def _click_of(self, view: CapturedView) -> Callable[[object], None]:
        return lambda _: self._clicked(view)
