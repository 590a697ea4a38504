"""RunPanel: figures and curves of a run, pause, stop and checkpoint, and exports."""

from __future__ import annotations

import html
from collections.abc import Generator
from typing import TYPE_CHECKING

import numpy as np
from viser import Icon

from gsfw.core.files.json_text import parsed_json
from gsfw.core.words import clock
from gsfw.viewer.export import export_splats
from gsfw.viewer.live_run import LiveRun
from gsfw.viewer.panels.figures import figures_html, status_html
from gsfw.viewer.panels.panel import Panel

if TYPE_CHECKING:
    import viser

    from gsfw.viewer.page import Page

CHART_HEIGHT = 170
"""Height of a chart, in pixels."""
COLORS = {"loss": "#e0864a", "psnr": "#4a9be0", "held out": "#7bd08a"}
"""Colours of the curves, which both light and dark pages carry."""


class RunPanel(Panel):
    """Figures and curves of the run, and buttons that act on it."""

    def __init__(self, page: Page) -> None:
        """Build the panel inside the current container of the page."""
        self._page, self._live = page, page.session.live
        self._gui = page.client.gui
        self._points, self._evaluations = -1, 0
        # Buttons come first: rows of figures appear as the run goes on, and would move them.
        if self._live is not None:
            self._add_controls(self._live)
        self._export = self._gui.add_button(
            "Export as PLY",
            icon=Icon.FILE_EXPORT,
            hint="the Gaussians at this time, for other tools",
        )
        self._export.on_click(lambda _: self._order_export())
        self._figures = self._gui.add_html("")
        if self._live is not None:
            self._add_charts()
        else:
            self._figures.content = figures_html(_finished(page))
        self.update()

    def _add_controls(self, live: LiveRun) -> None:
        self._bar = self._gui.add_progress_bar(0.0)
        self._pause = self._gui.add_button("Pause", icon=Icon.PLAYER_PAUSE)
        self._save = self._gui.add_button("Checkpoint", icon=Icon.DEVICE_FLOPPY, color="gray")
        self._stop = self._gui.add_button("Stop", icon=Icon.PLAYER_STOP, color="red")
        self._pause.on_click(lambda _: live.pause(not live.paused))
        self._save.on_click(lambda _: live.checkpoint())
        self._stop.on_click(lambda _: self._confirm_stop(live))

    def _add_charts(self) -> None:
        self._psnr = self._chart("PSNR of training views, dB", [("PSNR", COLORS["psnr"])])
        self._held_out = self._chart("PSNR of held-out views, dB", [("PSNR", COLORS["held out"])])
        self._held_out.visible = False
        self._loss = self._chart("Loss", [("loss", COLORS["loss"])])

    def _chart(self, title: str, series: list[tuple[str, str]]) -> viser.GuiUplotHandle:
        """An empty chart."""
        from viser import uplot

        lines = [
            uplot.Series(label=name, stroke=color, width=2, spanGaps=True) for name, color in series
        ]
        axis = uplot.Axis(stroke="#8c939c", grid=uplot.Axis_Grid(stroke="#8883", width=1))
        return self._gui.add_uplot(
            data=tuple(np.zeros(1) for _ in range(1 + len(series))),
            series=(uplot.Series(label="step"), *lines),
            title=title,
            axes=(axis, axis),
            scales={"x": uplot.Scale(time=False)},
            height=CHART_HEIGHT,
            padding=(14, 8, 0, 0),  # The uppermost number is not cut off.
        )

    def _confirm_stop(self, live: LiveRun) -> None:
        """Ask once more: a stopped run goes on only by hand."""
        with self._gui.add_modal("Stop the run?") as modal:
            self._gui.add_markdown(
                "It ends after this step, with a checkpoint. `gsfw resume` continues it."
            )
            sure = self._gui.add_button("Stop it", color="red")
            back = self._gui.add_button("Go on", color="gray")

        def stop(_: object) -> None:
            live.stop()
            modal.close()

        sure.on_click(stop)
        back.on_click(lambda _: modal.close())

    def _order_export(self) -> None:
        """Order an export; the thread that owns the model writes it."""
        page, live = self._page, self._live
        if live is not None and live.finished:
            page.tell("The run is over: open it with gsfw view to export it.", "yellow")
            return
        state = page.viewport.state

        def work() -> Generator[None, None, None]:
            # Only now the run stands still: its step is that of what is written.
            name = "view" if live is None else f"step_{live.step:06d}"
            try:
                path = page.session.free_path("exports", name, ".ply").with_suffix(".ply")
                count, notes = export_splats(page.session.model, state, path)
            except Exception as error:  # The disk is full, for instance: the run goes on.
                page.tell(f"Nothing was exported: {error}", "red")
            else:
                page.tell(f"{count:,} Gaussians are in {path}", "green")
                for note in notes:
                    page.tell(note, "yellow")
            yield

        page.session.service.order(work())

    def update(self) -> None:
        """Show the figures of the run."""
        live = self._live
        if live is None:
            return
        status = live.status
        self._figures.content = status_html(live)
        self._bar.value = 100.0 * live.step / max(live.info.steps, 1)  # type: ignore[misc]
        self._pause.label = "Resume" if live.paused else "Pause"
        self._pause.icon = Icon.PLAYER_PLAY if live.paused else Icon.PLAYER_PAUSE
        for button in (self._pause, self._save, self._stop, self._export):
            button.disabled = live.finished
        if status.step != self._points and len(live.loss.steps) > 1:
            self._points = status.step
            self._loss.data = live.loss.arrays()
            self._psnr.data = live.psnr.arrays()
        if len(live.held_out.steps) != self._evaluations:
            self._evaluations = len(live.held_out.steps)
            self._held_out.data = live.held_out.arrays()
            self._held_out.visible = True


def _finished(page: Page) -> list[tuple[str, str]]:
    """Rows of figures of a finished run or a file, by what its folder has."""
    model = page.session.model
    models = page.session.models
    names = (
        ["Gaussians"]
        if len(models) == 1
        else [f"Gaussians of {name}" for name in page.session.names]
    )
    rows = [(name, f"{item.model.num_rows:,}") for name, item in zip(names, models, strict=True)]
    path = page.session.folder / "metrics.json"
    if model.data.has_images and path.is_file():
        try:
            summary = parsed_json(path.read_text())
        except (OSError, ValueError):
            return rows
        for name, text in (("psnr", "{:.2f} dB"), ("ssim", "{:.4f}"), ("steps", "{:,}")):
            if isinstance(summary.get(name), (int, float)):
                label = name if name == "steps" else f"{name.upper()}, held-out views"
                rows.append((label, text.format(summary[name])))
        if isinstance(summary.get("train_seconds"), (int, float)):
            rows.append(("training took", clock(summary["train_seconds"])))
    return [(html.escape(name), html.escape(text)) for name, text in rows]
