"""ViewPanel: channel, time, Gaussians, crop and picture."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from viser import Icon

from gsfw.core.color_bytes import color_bytes
from gsfw.core.errors import UserError
from gsfw.rendering.channels import CHANNELS, available_channels
from gsfw.rendering.color_maps import color_bar
from gsfw.viewer.frame import Frame, ValueScale
from gsfw.viewer.panels.panel import Panel
from gsfw.viewer.view_state import Box

if TYPE_CHECKING:
    from gsfw.viewer.page import Page

BAR_HEIGHT = 150
"""Height of the colour bar, in pixels."""
LEAST_SIZE = 0.05
"""Least factor of the size of Gaussians: points."""
PHOTO = "photo"
"""Name of the channel that is the photo itself."""
HEIGHTS = ("360", "540", "720", "1080", "1440")
"""Choices of the largest height of a frame, in pixels."""


class ViewPanel(Panel):
    """Channel, time, Gaussians, crop and picture."""

    def __init__(self, page: Page) -> None:
        """Build the panel inside the current container of the page."""
        self._page, self._viewport = page, page.viewport
        self._gui = page.client.gui
        self._figures = self._gui.add_html("")
        self._scale: ValueScale | None = None
        self._add_channel()
        if page.session.model.is_dynamic:
            self._add_time()
        self._add_gaussians()
        self._add_crop()
        self._add_picture()

    def _add_channel(self) -> None:
        model = self._page.session.model
        channels = [
            channel
            for channel in available_channels(model.is_dynamic, model.has_photos)
            if channel.name != PHOTO  # The panel of cameras shows it.
        ]
        descriptions = "; ".join(f"{channel.name}: {channel.description}" for channel in channels)
        names = {channel.name.replace("_", " "): channel.name for channel in channels}
        chosen = self._gui.add_dropdown(
            "Show", list(names), initial_value="color", hint=descriptions
        )

        def choose(_: object) -> None:
            name = names[chosen.value]
            self._viewport.change(lambda state: replace(state, channel=name))
            if CHANNELS[name].needs_image and self._viewport.state.view is None:
                self._page.tell(
                    f"{name} compares with a photo: choose a view under Cameras.", "yellow"
                )

        chosen.on_update(choose)
        self._bar = self._gui.add_image(np.zeros((2, 2, 3), np.uint8), format="png", visible=False)

    def _add_time(self) -> None:
        with self._gui.add_folder("Time"):
            self._time = self._gui.add_slider("Time", 0.0, 1.0, 0.001, 0.0)
            self._moment = 0.0
            self._play = self._gui.add_button("Play", icon=Icon.PLAYER_PLAY)
            self._loop = self._gui.add_checkbox("Loop", True)
            self._speed = self._gui.add_slider(
                "Speed", 0.05, 4.0, 0.05, 1.0, hint="1: from the first time to the last in 4 s"
            )
            self._tracks = self._gui.add_checkbox(
                "Show tracks", False, hint="paths of some Gaussians over the last sixth of the time"
            )
        self._tracks.on_update(lambda _: self._show_tracks())
        self._time.on_update(self._time_moved)
        self._play.on_click(lambda _: self._toggle())
        self._loop.on_update(lambda _: self._follow())
        self._speed.on_update(lambda _: self._follow())

    def _time_moved(self, event: object) -> None:
        # The page's own moves of the slider, while it plays, come back here without a client.
        if getattr(event, "client", None) is not None:
            self._moment = float(self._time.value)
            self._viewport.change(lambda state: replace(state, time=self._moment))

    def _show_tracks(self) -> None:
        """Draw tracks; they are followed anew, since a model that trains has moved on."""
        wanted, page = bool(self._tracks.value), self._page
        self._viewport.change(lambda state: replace(state, tracks=wanted))
        if not wanted:
            return
        state = self._viewport.state

        def follow() -> Generator[None, None, None]:
            try:
                page.session.service.maker.make_trails(state)
            except UserError as error:
                page.tell(f"There are no tracks: {error.message} {error.advice}".strip())
            page.session.service.refresh()
            yield

        page.session.service.order(follow())

    def _toggle(self) -> None:
        self._viewport.play(not self._viewport.playback.playing)
        self._follow()

    def _follow(self) -> None:
        playback = self._viewport.playback
        playback.loop, playback.speed = bool(self._loop.value), float(self._speed.value)
        self._play.label = "Pause" if playback.playing else "Play"
        self._play.icon = Icon.PLAYER_PAUSE if playback.playing else Icon.PLAYER_PLAY

    def _add_gaussians(self) -> None:
        with self._gui.add_folder("Gaussians"):
            size = self._gui.add_slider(
                "Size", LEAST_SIZE, 1.0, 0.05, 1.0, hint="small: each Gaussian is a point"
            )
            most = self._page.session.first.sh_degree
            degree = self._gui.add_slider(
                "Colour bands",
                0,
                max(most, 1),
                1,
                most,
                hint="degree of spherical harmonics; 0: one colour from all sides, without gloss",
                visible=most > 0,
            )
            behind = self._gui.add_dropdown("Background", ["as trained", "black", "white", "other"])
            color = self._gui.add_rgb("Color", (30, 60, 90), visible=False)
        size.on_update(
            lambda _: self._viewport.change(
                lambda state: replace(state, splat_scale=float(size.value))
            )
        )
        degree.on_update(
            lambda _: self._viewport.change(
                lambda state: replace(state, sh_degree=int(degree.value))
            )
        )

        def recolor(_: object) -> None:
            color.visible = behind.value == "other"
            red, green, blue = (value / 255 for value in color.value)
            chosen = {"black": (0.0, 0.0, 0.0), "white": (1.0, 1.0, 1.0)}
            chosen["other"] = (red, green, blue)
            self._viewport.change(lambda state: replace(state, background=chosen.get(behind.value)))

        behind.on_update(recolor)
        color.on_update(recolor)

    def _add_crop(self) -> None:
        bounds = self._page.session.first.bounds
        with self._gui.add_folder("Crop", expand_by_default=False):
            on = self._gui.add_checkbox("Crop to the box", False)
            ranges = [
                self._gui.add_multi_slider(name, low, high, (high - low) / 200, (low, high))
                for name, low, high in zip("XYZ", bounds.low, bounds.high, strict=True)
                if high > low
            ]

        def crop(_: object) -> None:
            if not on.value or len(ranges) < 3:
                self._viewport.change(lambda state: replace(state, crop=None))
                return
            (x, right), (y, bottom), (z, back) = (item.value for item in ranges)
            self._viewport.change(
                lambda state: replace(state, crop=Box((x, y, z), (right, bottom, back)))
            )

        on.on_update(crop)
        for item in ranges:
            item.on_update(crop)

    def _add_picture(self) -> None:
        with self._gui.add_folder("Picture", expand_by_default=False):
            height = self._gui.add_dropdown(
                "Largest height", HEIGHTS, initial_value="1080", hint="of frames at rest, in pixels"
            )
            light = self._gui.add_checkbox("Light page", False)
            shot = self._gui.add_button("Screenshot", icon=Icon.CAMERA)
        light.on_update(lambda _: self._page.set_theme(dark=not light.value))
        height.on_update(
            lambda _: self._viewport.change(
                lambda state: replace(state, full_height=int(height.value))
            )
        )
        shot.on_click(lambda _: self._screenshot())

    def _screenshot(self) -> None:
        """Send the last frame as a PNG to save."""
        from io import BytesIO

        from PIL import Image

        frame = self._viewport.last_frame
        if frame is not None:
            content = BytesIO()
            Image.fromarray(frame.image).save(content, "PNG")
            self._page.client.send_file_download(
                "gsfw.png", content.getvalue(), save_immediately=True
            )

    def shown(self, frame: Frame) -> None:
        """Show the meaning of its colours."""
        if frame.scale == self._scale:
            return
        self._scale = frame.scale
        self._bar.visible = frame.scale is not None
        if frame.scale is not None:
            scale = frame.scale
            bar = color_bar(BAR_HEIGHT, scale.low, scale.high, scale.unit, scale.colormap)
            self._bar.image = color_bytes(bar).numpy()

    def update(self) -> None:
        """Show the speed, and move the slider with the time that plays."""
        frame = self._viewport.last_frame
        if frame is not None:
            height, width = frame.image.shape[:2]
            speed = self._viewport.frames_per_second()
            moving = "at rest" if self._viewport.resting else f"{speed:.0f} frames/s"
            self._figures.content = (
                f'<div style="font-size:12px;opacity:.7;padding:2px 9px">{width} &times; {height}'
                f" pixels in {1e3 * frame.seconds:.0f} ms &middot; {moving}</div>"
            )
        if self._page.session.model.is_dynamic:
            self._follow_time()

    def _follow_time(self) -> None:
        """Move the slider where the time has moved: it plays, or a view of the capture has one."""
        moment = self._viewport.state.time
        if moment != self._moment:
            self._moment = moment
            self._time.value = round(moment, 3)  # type: ignore[misc]
        if not self._viewport.playback.playing:
            self._follow()
