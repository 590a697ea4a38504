"""Parts that each break one promise of the conformance kit, for the tests that it is noticed."""

from support.broken_parts import datamanagers, rasterizers, small_parts, trained_parts
from support.broken_parts.registry import BROKEN, Plugin

__all__ = ["BROKEN", "Plugin", "datamanagers", "rasterizers", "small_parts", "trained_parts"]
