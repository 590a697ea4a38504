"""Notebook: whether this program is one, and outputs in it that change; needs no IPython."""

from __future__ import annotations

import sys
from typing import Any, Protocol, runtime_checkable


@runtime_checkable
class Shown(Protocol):
    """An object that a notebook shows as HTML."""

    def _repr_html_(self) -> str: ...


def is_notebook() -> bool:
    """True in a notebook (Jupyter, VS Code, Colab), false in a terminal, also in IPython's."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return getattr(shell, "kernel", None) is not None


class Output:
    """An output of the running cell that changes in place."""

    def __init__(self, content: Shown) -> None:
        """Show the content; call this in a notebook only."""
        display: Any = sys.modules["IPython"].display
        self._content = content
        self._handle = display.display(content, display_id=True)

    def refresh(self) -> None:
        """Show the present state of the content."""
        if self._handle is not None:
            self._handle.update(self._content)
