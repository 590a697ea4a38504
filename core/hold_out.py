"""HoldOutBy: the rules by which images are held out of training."""

from enum import Enum


class HoldOutBy(Enum):
    """The rule that chooses the held-out images; see ``datamanagers/holdout.py``."""

    AUTO = "auto"
    """The rule that suits the kind of capture."""
    NAME = "name"
    """Every n-th by name."""
    SPREAD = "spread"
    """As many as by name, from all places and directions."""
    CAMERA = "camera"
    """Whole cameras."""
