"""Page: the interface of one page in the browser, of panels."""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING

from gsfw.viewer.frame import Frame
from gsfw.viewer.panels.view_panel import ViewPanel
from gsfw.viewer.session import Session
from gsfw.viewer.view_state import Pose, ViewState
from gsfw.viewer.viewport import Viewport

if TYPE_CHECKING:
    import viser

BRAND = (64, 138, 214)
"""Colour of buttons and sliders."""
MOVING_QUALITY, STILL_QUALITY = 70, 95
"""JPEG qualities; at rest, differences to the render are invisible."""


class Page:
    """The interface of one page in the browser; its callbacks run in threads of the server."""

    def __init__(self, client: viser.ClientHandle, session: Session) -> None:
        """Build the interface, and show the scene from its first view."""
        self.client, self.session = client, session
        state = ViewState(pose=session.first.pose, sh_degree=4)
        self.viewport = Viewport(state, self._send, session.service.wake)
        self.viewport.problem = self._tell
        self._build()
        client.camera.on_update(self._moved)
        self._moved(client.camera)
        session.service.add(self.viewport)

    def _build(self) -> None:
        gui = self.client.gui
        gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, brand_color=BRAND
        )
        gui.set_panel_label(self.session.title)
        tabs = gui.add_tab_group()
        with tabs.add_tab("View"):
            self.view_panel = ViewPanel(self)
        self._panels = [self.view_panel]

    def _moved(self, camera: viser.CameraHandle) -> None:
        """Follow the camera of the page."""
        if not (camera.image_width > 0 and camera.image_height > 0 and math.isfinite(camera.fov)):
            return
        px, py, pz = (float(value) for value in camera.position)
        w, x, y, z = (float(value) for value in camera.wxyz)
        pose = Pose((px, py, pz), (w, x, y, z), float(camera.fov))
        self.viewport.change(pose=pose, width=camera.image_width, height=camera.image_height)

    def _send(self, frame: Frame, still: bool) -> None:
        """Encode and send a frame; runs in the viewport's thread."""
        self.client.scene.set_background_image(
            frame.image, format="jpeg", jpeg_quality=STILL_QUALITY if still else MOVING_QUALITY
        )
        for panel in self._panels:
            panel.shown(frame)

    def _tell(self, text: str) -> None:
        """Show a message on the page."""
        self.client.add_notification("gsfw", text, auto_close_seconds=8.0, color="red")

    def update(self) -> None:
        """Refresh figures that change without a frame; called a few times a second."""
        for panel in self._panels:
            panel.update()

    def close(self) -> None:
        """The page is gone."""
        self.session.service.remove(self.viewport)


class Pages:
    """All open pages of a session, and the clock that refreshes their figures."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._pages: dict[int, Page] = {}
        self._closed = threading.Event()
        self._ticker = threading.Thread(target=self._tick, name="viewer-figures", daemon=True)
        self._ticker.start()

    def opened(self, client: viser.ClientHandle) -> None:
        """Build the interface of a new page."""
        self._pages[client.client_id] = Page(client, self._session)

    def gone(self, client: viser.ClientHandle) -> None:
        """Forget a closed page."""
        page = self._pages.pop(client.client_id, None)
        if page is not None:
            page.close()

    def _tick(self) -> None:
        while not self._closed.wait(UPDATE_SECONDS):
            for page in tuple(self._pages.values()):
                page.update()

    def close(self) -> None:
        """Stop the clock, and want no frames any more."""
        self._closed.set()
        self._ticker.join()
        for page in tuple(self._pages.values()):
            page.close()


UPDATE_SECONDS = 0.5
"""Time between two updates of the figures."""
