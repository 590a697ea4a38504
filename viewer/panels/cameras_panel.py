"""CamerasPanel: the views of the capture: photo, render and error of one, and its place."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gsfw.viewer.camera_frusta import CameraFrusta
from gsfw.viewer.frame import Frame
from gsfw.viewer.panels.figures import figures_html
from gsfw.viewer.panels.panel import Panel
from gsfw.viewer.view_state import CapturedView, Comparison, Pose

if TYPE_CHECKING:
    from gsfw.viewer.page import Page

NONE = "free view"
"""The choice of no captured view."""
MOVED = 1e-3
"""Change of a position, relative to the scene, or of a rotation's entries, that leaves a view."""


class CamerasPanel(Panel):
    """Chooses a captured view, and how it is compared with its photo."""

    def __init__(self, page: Page) -> None:
        """Build the panel inside the current container of the page."""
        self._page, self._viewport = page, page.viewport
        gui, model = page.client.gui, page.session.model
        self._views = {model.view_name(view): view for view in model.captured()}
        self._frusta = CameraFrusta(
            page.client, page.session, tuple(self._views.values()), self.enter
        )
        self._anchor = self._left = self._viewport.state.pose
        self._arrived = True
        """True once the page has told that its camera is where it was put."""
        self._choice = gui.add_dropdown("View", (NONE, *self._views))
        steps = gui.add_button_group("Go to", ("Previous", "Next", "Nearest"))
        self._figures = gui.add_html("")
        self._comparison = gui.add_dropdown(
            "Compare",
            [item.value for item in Comparison] if model.has_photos else [Comparison.RENDER.value],
            initial_value=(
                Comparison.SIDE_BY_SIDE if model.has_photos else Comparison.RENDER
            ).value,
            hint="of a view: its render, its photo, one of them left of a line, or all, with error",
        )
        self._wipe = gui.add_slider("Line", 0.0, 1.0, 0.01, 0.5, visible=False)
        self._shown = gui.add_checkbox("Show cameras", False, hint="click one to look through it")
        size = self._size = gui.add_slider("Camera size", 0.2, 4.0, 0.1, 1.0, visible=False)
        self._choice.on_update(lambda _: self._choose())
        steps.on_click(lambda _: self._go(steps.value))
        self._comparison.on_update(lambda _: self._compare())
        self._wipe.on_update(lambda _: self._compare())
        self._shown.on_update(lambda _: self._show_frusta())
        size.on_update(lambda _: self._frusta.resize(float(size.value)))

    def enter(self, view: CapturedView) -> None:
        """Look through the camera of a view."""
        name = next(name for name, other in self._views.items() if other == view)
        self._viewport.play(False)  # The photo has one time.
        camera = self._page.session.model.camera(view)
        moment = None if camera.time is None else float(camera.time[0])
        comparison = Comparison(self._comparison.value)
        self._left, self._anchor = self._viewport.state.pose, Pose.of(camera)
        self._arrived = False
        self._viewport.change(
            lambda state: replace(
                state,
                view=view,
                comparison=comparison,
                wipe=float(self._wipe.value),
                time=state.time if moment is None else moment,
            )
        )
        if self._choice.value != name:
            self._choice.value = name  # type: ignore[misc]
        self._wipe.visible = comparison is Comparison.WIPE
        self._show_frusta()
        self._anchor = self._page.place(self._anchor)

    def leave(self) -> None:
        """Move freely again."""
        self._viewport.change(
            lambda state: replace(state, view=None, comparison=self._page.free_comparison)
        )
        if self._choice.value != NONE:
            self._choice.value = NONE  # type: ignore[misc]
        self._figures.content = ""
        self._show_frusta()

    def moved(self, pose: Pose) -> None:
        """Leave the view once the page's camera is moved away from it."""
        self._frusta.seen_from(pose.position)
        if self._viewport.state.view is None:
            return
        size = self._page.session.first.size
        if not self._arrived:
            # Poses that were reported before the page's camera was put there may come after it.
            to_here = _distance(pose, self._anchor, size)
            self._arrived = to_here <= _distance(pose, self._left, size)
        if self._arrived and _distance(pose, self._anchor, size) > MOVED:
            self.leave()

    def shown(self, frame: Frame) -> None:
        """Show the figure of the view."""
        view = self._viewport.state.view
        if view is None or frame.psnr is None:
            return
        camera = self._page.session.model.camera(view)
        rows = [
            ("PSNR", f"{frame.psnr:.2f} dB"),
            ("photo", f"{camera.width} &times; {camera.height} pixels"),
        ]
        if frame.psnr_size != (camera.width, camera.height):
            size = f"{frame.psnr_size[0]} &times; {frame.psnr_size[1]}"
            rows.append(("compared at", f"{size}, as this page is smaller"))
        self._figures.content = figures_html(rows)

    def _choose(self) -> None:
        chosen = self._views.get(self._choice.value)
        if chosen == self._viewport.state.view:
            return
        if chosen is None:
            self.leave()
        else:
            self.enter(chosen)

    def _go(self, where: str) -> None:
        """Go to the view before or after this one, or to that nearest to the page's camera."""
        views = list(self._views.values())
        if where == "Nearest":
            position = np.asarray(self._viewport.state.pose.position)
            cameras = [Pose.of(self._page.session.model.camera(view)).position for view in views]
            distances = [float(np.linalg.norm(np.asarray(one) - position)) for one in cameras]
            self.enter(views[int(np.argmin(distances))])
            return
        current = self._viewport.state.view
        step = 1 if where == "Next" else -1
        place = -1 if current is None else views.index(current)
        self.enter(views[(max(place, 0) + step) % len(views) if current else 0])

    def _compare(self) -> None:
        comparison, wipe = Comparison(self._comparison.value), float(self._wipe.value)
        self._wipe.visible = comparison is Comparison.WIPE
        if self._viewport.state.view is not None:
            self._viewport.change(lambda state: replace(state, comparison=comparison, wipe=wipe))
        elif self._views and comparison is not Comparison.RENDER:
            self._go("Nearest")

    def _show_frusta(self) -> None:
        """Frusta fit the image only while it is one render from the page's own camera."""
        state = self._viewport.state
        single = state.view is None and state.comparison is not Comparison.SIDE_BY_SIDE
        self._frusta.show(bool(self._shown.value) and single)
        self._size.visible = bool(self._shown.value)


def _distance(pose: Pose, other: Pose, size: float) -> float:
    """The larger of the shift, relative to the scene, and of the change of a rotation's entries."""
    shift = np.linalg.norm(np.subtract(pose.position, other.position)) / size
    turn = min(
        np.abs(np.subtract(pose.wxyz, other.wxyz)).max(),
        np.abs(np.add(pose.wxyz, other.wxyz)).max(),
    )
    return float(max(shift, turn))
