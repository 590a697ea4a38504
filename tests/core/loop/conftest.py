"""Fixtures of recorded steps."""

import pytest
from support.native_programs import compiler

from gsfw.core import render_output


@pytest.fixture
def unknown_to_the_host(monkeypatch):
    """On a GPU the host does not know whether a step was finite; and few steps are enough here."""
    compiler()
    monkeypatch.setattr("gsfw.core.loop.step_graphs.FIRST_STEPS", 0)
    monkeypatch.setattr(render_output, "known_by_host", lambda flag: False)
