"""Fixtures of the tests of sources."""

from pathlib import Path

import pytest
from support.source_photos import photos


@pytest.fixture
def folder(tmp_path) -> Path:
    """Two good photos, so that something can be used."""
    return photos(tmp_path / "shots", "a.png", "b.png")
