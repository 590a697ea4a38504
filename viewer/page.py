"""Page: the interface of one page in the browser, of panels."""

from __future__ import annotations

import logging
import math
import threading
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from gsfw.viewer.delivery import wait_until_taken
from gsfw.viewer.frame import Frame
from gsfw.viewer.panels.cameras_panel import CamerasPanel
from gsfw.viewer.panels.compare_panel import ComparePanel
from gsfw.viewer.panels.panel import Panel
from gsfw.viewer.panels.path_panel import PathPanel
from gsfw.viewer.panels.run_panel import RunPanel
from gsfw.viewer.panels.view_panel import ViewPanel
from gsfw.viewer.session import Session
from gsfw.viewer.view_state import Comparison, Pose, ViewState
from gsfw.viewer.viewport import Viewport

logger = logging.getLogger(__name__)

if TYPE_CHECKING:
    import viser

BRAND = (64, 138, 214)
"""Colour of buttons and sliders."""
DARK, LIGHT = 0.07, 0.93
"""Grey of what no image covers, in a dark and in a light page."""
MOVING_QUALITY, STILL_QUALITY = 70, 95
"""JPEG qualities; at rest, differences to the render are invisible."""
UPDATE_SECONDS = 0.5
"""Time between two updates of the figures."""


class Page:
    """The interface of one page in the browser; its callbacks run in threads of the server."""

    def __init__(self, client: viser.ClientHandle, session: Session) -> None:
        """Build the interface, and show the scene from its first view."""
        self.client, self.session = client, session
        self.free_comparison = Comparison.RENDER
        """Arrangement of two runs while the page moves freely."""
        self._cameras: CamerasPanel | None = None
        self._panels: tuple[Panel, ...] = ()
        self._reported = session.first.pose
        state = ViewState(pose=session.first.pose)
        self.viewport = Viewport(state, self._send, session.service.wake)
        self.viewport.problem = self.tell
        self._build()
        client.camera.on_update(self._moved)
        self._moved(client.camera)
        session.service.add(self.viewport)

    def _build(self) -> None:
        gui = self.client.gui
        self.set_theme(dark=True)
        gui.set_panel_label(self.session.title)
        gui.main_panel.dock_right()  # Beside the image, of which it covers nothing.
        tabs = gui.add_tab_group()
        with tabs.add_tab("View"):
            compare = ComparePanel(self) if len(self.session.models) > 1 else None
            panels: list[Panel] = [ViewPanel(self), *([compare] if compare else [])]
        if self.session.model.captured():
            with tabs.add_tab("Cameras"):
                self._cameras = CamerasPanel(self)
            panels.append(self._cameras)
        with tabs.add_tab("Path"):
            panels.append(PathPanel(self))
        with tabs.add_tab("Run"):
            panels.append(RunPanel(self))
        self._panels = tuple(panels)

    def set_theme(self, dark: bool) -> None:
        """Dark or light: the panel, and what no image covers."""
        self.client.gui.configure_theme(
            dark_mode=dark, show_logo=False, show_share_button=False, brand_color=BRAND
        )
        behind = DARK if dark else LIGHT
        self.viewport.change(lambda state: replace(state, behind=behind))

    def _moved(self, camera: viser.CameraHandle) -> None:
        """Follow the camera of the page."""
        if not (camera.image_width > 0 and camera.image_height > 0 and math.isfinite(camera.fov)):
            return
        pose = _pose(camera)
        if pose != self._reported:  # Whoever drags wants no flight any more.
            self._reported = pose
            self.viewport.land()
        width, height = camera.image_width, camera.image_height
        self.viewport.change(lambda state: replace(state, pose=pose, width=width, height=height))
        if self._cameras is not None:
            self._cameras.moved(pose)

    def place(self, pose: Pose) -> Pose:
        """Move the page's camera, but for its roll, which orbits keep upright; the new pose."""
        self.viewport.land()
        camera = self.client.camera
        to_scene = np.linalg.inv(pose.world_to_camera().numpy())
        position, axis = to_scene[:3, 3], to_scene[:3, 2]
        distance = float(np.linalg.norm(np.asarray(self.session.first.target) - position))
        with self.client.atomic():
            camera.position = position
            camera.look_at = position + max(distance, 1e-3 * self.session.first.size) * axis
            camera.fov = pose.fov
        placed = _pose(camera)
        self.viewport.change(lambda state: replace(state, pose=placed))
        return placed

    def _send(self, frame: Frame, still: bool) -> None:
        """Encode and send a frame; runs in the viewport's thread."""
        self.client.scene.set_background_image(
            frame.image, format="jpeg", jpeg_quality=STILL_QUALITY if still else MOVING_QUALITY
        )
        for panel in self._panels:
            panel.shown(frame)
        wait_until_taken(self.client, lambda: self.closed)

    def tell(self, text: str, color: Literal["red", "yellow", "green"] = "red") -> None:
        """Show a message on the page for some seconds."""
        if not self.closed:
            self.client.add_notification("gsfw", text, auto_close_seconds=8.0, color=color)

    @property
    def closed(self) -> bool:
        """True if the page is gone: what it ordered may still be in work."""
        return self.viewport.closed

    def update(self) -> None:
        """Refresh figures that change without a frame; called a few times a second."""
        if self.closed:
            return
        for panel in self._panels:
            panel.update()

    def close(self) -> None:
        """The page is gone."""
        self.session.service.remove(self.viewport)


def _pose(camera: viser.CameraHandle) -> Pose:
    px, py, pz = (float(value) for value in camera.position)
    w, x, y, z = (float(value) for value in camera.wxyz)
    return Pose((px, py, pz), (w, x, y, z), float(camera.fov))


class Pages:
    """All open pages of a session, and the clock that refreshes their figures."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._pages: dict[int, Page] = {}
        self._left: set[int] = set()
        """Pages that were closed before their interface was built."""
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._ticker = threading.Thread(target=self._tick, name="viewer-figures", daemon=True)
        self._ticker.start()

    def opened(self, client: viser.ClientHandle) -> None:
        """Build the interface of a new page."""
        page = Page(client, self._session)
        with self._lock:
            left = client.client_id in self._left
            if not left:
                self._pages[client.client_id] = page
        if left:
            page.close()

    def gone(self, client: viser.ClientHandle) -> None:
        """Forget a closed page."""
        with self._lock:
            page = self._pages.pop(client.client_id, None)
            if page is None:
                self._left.add(client.client_id)
        if page is not None:
            page.close()

    def update(self) -> None:
        """Refresh the figures of every page."""
        for page in tuple(self._pages.values()):
            try:
                page.update()
            except Exception:  # The page may be closed in the middle; the others go on.
                logger.debug("the figures of a page failed", exc_info=True)

    def _tick(self) -> None:
        while not self._closed.wait(UPDATE_SECONDS):
            self.update()

    def close(self) -> None:
        """Stop the clock, and want no frames any more."""
        self._closed.set()
        self._ticker.join()
        for page in tuple(self._pages.values()):
            page.close()
