"""The built-in scene at a size that trains in a second, and where real captures lie."""

from pathlib import Path

SHARED_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
"""Real captures beside the checkout; not on every machine."""

SMALL_SCENE = (
    "datamanager.views=6",
    "datamanager.eval_views=2",
    "datamanager.width=32",
    "datamanager.height=24",
    "datamanager.points=150",
)
