"""Fixtures that several folders of tests share."""

from pathlib import Path

import pytest

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture
def shared_data() -> Path:
    """Real captures beside the checkout; tests that use them skip where there are none."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the folder of real captures (../shared/data) is not on this machine")
    return SHARED_DATA
