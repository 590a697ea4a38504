"""PathPanel: a camera path by key frames: preview, film, and the file of ``gsfw render``."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from viser import Icon

from gsfw.core.errors import UserError
from gsfw.core.files.json_text import parsed_json
from gsfw.rendering.key_frames import (
    FPS,
    SECONDS,
    CameraPath,
    KeyFrame,
    camera_path_of,
    write_camera_path,
)
from gsfw.viewer.film_task import FilmOrder, film_task
from gsfw.viewer.key_frames import (
    PathStates,
    key_frame,
    pose_of,
    with_key_frame,
    without_seconds,
)
from gsfw.viewer.panels.panel import Panel

if TYPE_CHECKING:
    import viser

    from gsfw.viewer.page import Page

COLOR = (110, 200, 130)
"""Colour of the path and of its key frames."""
SIZE = 0.02
"""Size of a key frame's frustum, relative to that of the scene."""
LINE = 2.0
"""Thickness of lines, in pixels."""
NO_KEY = "none"
NAME = "flight"
"""Name of the files, unless the page gives one; not that of a path of gsfw render, whose frames
would get the same folder."""
HEIGHTS = ("360", "540", "720", "1080")
"""Choices of the height of a film, in pixels."""


class PathPanel(Panel):
    """Key frames, and what is made of them."""

    def __init__(self, page: Page) -> None:
        """Build the panel inside the current container of the page."""
        self._page, self._viewport = page, page.viewport
        self._keys: list[KeyFrame] = []
        self._quiet = False
        self._drawn: list[viser.SceneNodeHandle] = []
        self._build_keys()
        self._build_film()

    def _build_keys(self) -> None:
        gui = self._page.client.gui
        add = gui.add_button("Add key frame", icon=Icon.PLUS, hint="of the page's own camera")
        self._chosen = gui.add_dropdown("Key frame", (NO_KEY,))
        edit = self._edits = gui.add_button_group("This one", ("Go to", "Replace", "Remove"))
        add.on_click(lambda _: self._set(with_key_frame(self._keys, self._here())))
        edit.on_click(lambda _: self._edit(edit.value))
        self._chosen.on_update(lambda _: self._edit("Go to"))

    def _build_film(self) -> None:
        gui = self._page.client.gui
        with gui.add_folder("Film"):
            self._seconds = gui.add_slider("Seconds", 1.0, 60.0, 0.5, SECONDS)
            self._fps = gui.add_slider("Frames/s", 10, 60, 5, round(FPS))
            self._closed = gui.add_checkbox("Closed loop", False)
            self._height = gui.add_dropdown("Height", HEIGHTS, initial_value="720")
            preview = self._preview_button = gui.add_button(
                "Preview", icon=Icon.PLAYER_PLAY, color="gray"
            )
            render = self._render_button = gui.add_button("Render film", icon=Icon.MOVIE)
            self._progress = gui.add_progress_bar(0.0, visible=False)
        with gui.add_folder("File"):
            self._name = gui.add_text("Name", NAME, hint="where it is taken, a number follows it")
            save = self._save_button = gui.add_button(
                "Save path", icon=Icon.DEVICE_FLOPPY, color="gray"
            )
            load = gui.add_upload_button(
                "Open path", icon=Icon.UPLOAD, color="gray", mime_type="application/json"
            )
            self._command = gui.add_markdown("")
        self._closed.on_update(lambda _: self._draw())
        self._seconds.on_update(self._retime)
        preview.on_click(lambda _: self._preview())
        render.on_click(lambda _: self._render())
        save.on_click(lambda _: self._save())
        load.on_upload(lambda _: self._load(load.value.content))
        self._enable()

    def _enable(self) -> None:
        """Offer what the number of key frames allows."""
        some = bool(self._keys)
        self._chosen.visible = self._edits.visible = some
        self._render_button.disabled = self._save_button.disabled = not some
        self._preview_button.disabled = len(self._keys) < 2

    @property
    def _path(self) -> CameraPath:
        state = self._viewport.state
        height = int(self._height.value)
        width = round(height * state.width / max(state.height, 1))
        return CameraPath(
            tuple(self._keys),
            fps=float(self._fps.value),
            seconds=float(self._seconds.value),
            closed=bool(self._closed.value),
            width=width - width % 2,  # Films have even sizes.
            height=height,
        )

    def _here(self) -> KeyFrame:
        model = self._page.session.model
        return key_frame(self._viewport.state, model.scene, model.is_dynamic)

    def _set(self, keys: list[KeyFrame], chosen: int = -1) -> None:
        """Take new key frames; one of them is chosen."""
        self._keys = keys
        names = [f"key frame {number + 1}" for number in range(len(keys))] or [NO_KEY]
        self._quiet = True
        self._chosen.options = tuple(names)
        self._chosen.value = names[chosen]  # type: ignore[misc]
        self._quiet = False
        self._enable()
        self._draw()

    def _edit(self, what: str) -> None:
        if not self._keys or self._quiet or self._chosen.value == NO_KEY:
            return
        place = int(self._chosen.value.rpartition(" ")[2]) - 1
        if what == "Remove":
            del self._keys[place]
            self._set(self._keys, min(place, len(self._keys) - 1))
        elif what == "Replace":
            self._keys[place] = replace(self._here(), seconds=self._keys[place].seconds)
            self._set(self._keys, place)
        else:
            key = self._keys[place]
            pose = pose_of(key.camera_to_world, key.fov, self._page.session.model.scene)
            if key.time is not None:
                moment = key.time
                self._viewport.change(lambda state: replace(state, time=moment))
            self._page.place(pose)

    def _retime(self, event: object) -> None:
        """Pass the key frames evenly over the new length; seconds of a file are given up."""
        timed = any(key.seconds is not None for key in self._keys)
        if timed and getattr(event, "client", None) is not None:
            self._keys = without_seconds(self._keys)
            self._page.tell("The key frames share the new length evenly.", "yellow")

    def _draw(self) -> None:
        """Draw the key frames, and the path through them."""
        with self._page.client.atomic():
            for handle in self._drawn:
                handle.remove()
            self._drawn = [self._draw_key(number) for number in range(len(self._keys))]
            if len(self._keys) > 1:
                self._drawn.append(self._draw_line())

    def _draw_key(self, number: int) -> viser.SceneNodeHandle:
        key, session = self._keys[number], self._page.session
        pose = pose_of(key.camera_to_world, key.fov, session.model.scene)
        return self._page.client.scene.add_camera_frustum(
            f"/path/{number}",
            fov=pose.fov,
            aspect=16 / 9,
            scale=SIZE * session.first.size,
            thickness=LINE,
            thickness_units="screen",
            color=COLOR,
            wxyz=pose.wxyz,
            position=pose.position,
        )

    def _draw_line(self) -> viser.SceneNodeHandle:
        states, state = self._states(), self._viewport.state
        places = [states.at(number, state).pose.position for number in range(len(states))]
        points = np.asarray(places, np.float32)
        return self._page.client.scene.add_line_segments(
            "/path/line",
            points=np.stack([points[:-1], points[1:]], axis=1),
            colors=COLOR,
            thickness=LINE,
            thickness_units="screen",
        )

    def _states(self) -> PathStates:
        return PathStates.of(self._path, self._page.session.model.scene)

    def _preview(self) -> None:
        """Let the page fly along the path once."""
        if len(self._keys) < 2:
            self._page.tell("A path needs two key frames: move, and add another.", "yellow")
            return
        self._viewport.fly(self._states())

    def _render(self) -> None:
        """Order the film."""
        page, live = self._page, self._page.session.live
        if not self._keys:
            page.tell("Add a key frame first.", "yellow")
            return
        if live is not None and live.finished:
            page.tell("The run is over: open it with gsfw view to render a film.", "yellow")
            return
        path = self._path
        state = replace(
            self._viewport.state, width=path.width, height=path.height, full_height=path.height
        )
        states = self._states()
        self._progress.visible = True

        def progress(count: int) -> None:
            if not page.closed:
                self._progress.value = 100.0 * count / len(states)  # type: ignore[misc]

        def done(text: str) -> None:
            if not page.closed:
                self._progress.visible = False
                page.tell(text, "red" if text.startswith("There is no film") else "green")

        try:
            stem = page.session.free_path("films", self._name.value, ".mp4", ".webp")
        except OSError as error:
            done(f"There is no film: {error}")
            return
        order = FilmOrder(states, state, stem, progress, done)
        page.session.service.order(film_task(order, page.session))

    def _save(self) -> None:
        """Write the key frames, and say how to render them."""
        if not self._keys:
            self._page.tell("Add a key frame first.", "yellow")
            return
        session = self._page.session
        try:
            file = session.free_path("paths", self._name.value, ".json").with_suffix(".json")
            write_camera_path(file, self._path)
        except (UserError, OSError) as error:
            self._page.tell(f"The path was not saved: {error}", "red")
            return
        command = shlex.join(["gsfw", "render", session.source, f"camera={file}"])
        self._command.content = f"`{command}`"
        self._page.tell(f"The path is in {file}", "green")

    def _load(self, content: bytes) -> None:
        """Take the key frames of a file."""
        try:
            path = camera_path_of(parsed_json(content), Path("this file"))
        except UserError as error:
            self._page.tell(f"{error.message} {error.advice}".strip(), "red")
            return
        except ValueError as error:
            self._page.tell(f"This file is no JSON: {error}", "red")
            return
        self._seconds.value = min(max(path.seconds, 1.0), 60.0)  # type: ignore[misc]
        self._fps.value = min(max(5 * round(path.fps / 5), 10), 60)  # type: ignore[misc]
        self._closed.value = path.closed  # type: ignore[misc]
        self._set(list(path.key_frames))
