"""TrainingViewer: the viewer of a run that trains; frames are rendered between its steps.

The training thread itself renders them, so that nothing is locked or copied, the model is never
half changed, and the run has the same bits with and without a page.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from typing import Any

from gsfw.core.callback import Callback, Control, EvaluatedView, RunInfo, StepReport
from gsfw.core.errors import ConfigError
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.progress import stage
from gsfw.plugins.registry import installed
from gsfw.viewer.config import PORT_KEY
from gsfw.viewer.frame_service import MOVING_SECONDS
from gsfw.viewer.live_run import LiveRun
from gsfw.viewer.page import Pages
from gsfw.viewer.server import ViewerServer, bound
from gsfw.viewer.session import Session
from gsfw.viewer.time_share import TimeShare
from gsfw.viewer.viewed_model import ViewedModel

REFRESH_SECONDS = 2.0
"""A page that does not move gets a new image of the model as often as this."""
MOVING_PERIOD = 0.25
"""A page that moves shall get a frame as often as this, within the share of the time."""
ABANDONED_SECONDS = 60.0
"""A paused run that no page has shown for so long goes on: nobody is there to resume it."""

STOPPED = "stopped on the viewer's page"


class TrainingViewer(Callback):
    """Serves the page of a run between its steps, and carries out what the page asks for."""

    def __init__(self, port: int, share: float) -> None:
        """Listen on ``port`` once the run starts; frames take ``share`` of the time at most."""
        self._port, self._share = port, share
        self._server: ViewerServer | None = None
        self._pages: Pages | None = None
        self._live: LiveRun | None = None
        self._control: Control | None = None
        self._session: Session | None = None
        self._time = TimeShare(share, time.monotonic())
        self._refreshed = 0.0
        self._sending = False

    def on_start(self, run: RunInfo, control: Control) -> None:
        """Open the server, and print its address."""
        if run.model is None:
            raise ConfigError(
                "viewer=true: the page needs all Gaussians, and several processes share them.",
                "Train with viewer=false, and open the result with gsfw view.",
            )
        self._control = control
        handle = run.model
        background = handle.settings.background
        assert background is not None
        assert run.data is not None
        tags = installed().find("method", run.method).tags
        model = ViewedModel(
            name=f"{run.method} on {run.scene}",
            model=handle.model,
            rasterizer=handle.rasterizer,
            settings=handle.settings,
            scene=run.data.scene,
            device=background.device,
            data=run.data,
            subject=f"{run.method} on {run.scene}",
            is_dynamic=run.data.scene.is_dynamic and "static" not in tags,
        )
        server = self._server = ViewerServer(bound(self._port, PORT_KEY))
        session = Session((model,), run.folder, str(run.folder))
        live = session.live = LiveRun(run, session.service.wake)
        session.service.moving_seconds = self._share * MOVING_PERIOD
        pages = Pages(session)
        server.start(session, pages)
        self._session, self._live, self._pages = session, live, pages
        sys.stderr.write(f"viewer: {server.address}\n  from elsewhere first: {server.ssh_line}\n")
        self._time = TimeShare(self._share, time.monotonic())

    def on_tick(self, step: int, control: Control) -> None:
        """Serve pages for as long as the share allows; while they hold the run, without limit."""
        assert self._live is not None
        self._live.ticked(step)
        self._serve_within_share()
        self._hold(control)
        self._carry_out(control)

    def on_view(self, step: int, view: EvaluatedView) -> None:
        """Serve pages during an evaluation too."""
        self._serve_within_share()

    def on_step(self, report: StepReport, control: Control) -> None:
        """Take the figures."""
        assert self._live is not None
        self._live.observe(report)

    def on_evaluation(self, step: int, evaluation: Evaluation, control: Control) -> None:
        """Take the figures."""
        assert self._live is not None
        self._live.evaluated(step, evaluation.means.get("psnr"), len(evaluation.views))

    def on_checkpoint(self, step: int, path: object) -> None:
        """Tell the page; a run that is held goes on waiting after the checkpoint."""
        if self._live is None or self._control is None:
            return
        self._live.checkpointed = step
        while self._is_held and self._control.stop_reason is None:
            self._hold(self._control)
            stop, _ = self._live.take_wishes()  # This step has its checkpoint.
            if stop:
                self._control.request_stop(STOPPED)

    def on_end(self, step: int, summary: Mapping[str, Any]) -> None:
        """Tell the pages that the run has ended."""
        if self._live is not None and self._pages is not None:
            self._live.finished = True
            self._pages.update()

    def close(self) -> None:
        """Close the pages and the server, and give up what pages have ordered."""
        if self._session is not None:
            self._session.service.close()
        if self._pages is not None:
            self._pages.close()
        if self._server is not None:
            self._server.close()
        self._pages = self._server = None

    def _serve_within_share(self) -> None:
        assert self._session is not None
        assert self._live is not None
        service, now = self._session.service, time.monotonic()
        self._time.trained(now, self._sending)
        if service.pages and now - self._refreshed > REFRESH_SECONDS:
            self._refreshed = now
            service.refresh()
        while self._time.allowed and service.serve_frame():
            self._time.rendered(time.monotonic())
        self._sending = service.sending
        self._live.share = self._time.measured

    @property
    def _is_held(self) -> bool:
        """True while a page pauses the run, or waits for what it has ordered.

        The model must not change in the middle of a film, and none is too long to wait for: whoever
        orders it sees how far it is.
        """
        assert self._session is not None
        assert self._live is not None
        return self._live.paused or self._session.service.has_orders

    def _hold(self, control: Control) -> None:
        """Serve pages without a limit until the run may go on, or a page wants something of it."""
        assert self._session is not None
        assert self._live is not None
        service, live = self._session.service, self._live
        if not self._is_held or live.has_wishes or control.stop_reason is not None:
            return
        service.moving_seconds = MOVING_SECONDS
        service.refresh()
        began = seen = time.monotonic()
        with stage("waiting for the viewer's page"), live.waits():
            while self._is_held and not live.has_wishes and control.stop_reason is None:
                if not service.serve_one():
                    service.wait()
                seen = time.monotonic() if service.pages else seen
                if time.monotonic() - seen > ABANDONED_SECONDS:
                    live.pause(False)
        live.skip(time.monotonic() - began)
        service.moving_seconds = self._share * MOVING_PERIOD
        self._time.skip(time.monotonic())

    def _carry_out(self, control: Control) -> None:
        """Pass what pages asked for on to the trainer."""
        assert self._live is not None
        stop, checkpoint = self._live.take_wishes()
        if stop:
            control.request_stop(STOPPED)
        if checkpoint:
            control.request_checkpoint()
