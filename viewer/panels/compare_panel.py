"""ComparePanel: two runs in one page: one, the other, a line between them, or side by side."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from gsfw.viewer.panels.panel import Panel
from gsfw.viewer.view_state import Comparison
from gsfw.viewer.viewed_model import same_world

if TYPE_CHECKING:
    from gsfw.viewer.page import Page

STRANGERS = (
    "They have no captured view in common. Both are seen from one camera, as if their worlds were "
    "the same."
)
"""Said where nothing tells that two models show one world."""


class ComparePanel(Panel):
    """Chooses how two runs are shown."""

    def __init__(self, page: Page) -> None:
        """Build the panel inside the current container of the page."""
        gui, viewport = page.client.gui, page.viewport
        first, second = page.session.names
        choices = {
            "side by side": Comparison.SIDE_BY_SIDE,
            "line between": Comparison.WIPE,
            f"left: {first}": Comparison.RENDER,
            f"right: {second}": Comparison.OTHER,
        }
        with gui.add_folder("Compare"):
            choice = gui.add_dropdown("Runs", list(choices), initial_value="side by side")
            wipe = gui.add_slider("Line", 0.0, 1.0, 0.01, 0.5, visible=False)
            if not same_world(*page.session.models):
                gui.add_markdown(STRANGERS)

        def change(_: object) -> None:
            comparison = choices[choice.value]
            wipe.visible = comparison is Comparison.WIPE
            page.free_comparison = comparison
            viewport.change(
                lambda state: replace(state, comparison=comparison, wipe=float(wipe.value))
            )

        choice.on_update(change)
        wipe.on_update(change)
        change(None)
