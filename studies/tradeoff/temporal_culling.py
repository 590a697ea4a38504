"""TemporalCulling: splats that are too faint at a time are not drawn then."""

from __future__ import annotations

from dataclasses import dataclass

from gsfw.core.splats import Splats


@dataclass(frozen=True)
class TemporalCulling:
    """Leaves out, at each time, the splats that are fainter then; all are stored as before."""

    opacity: float
    """The least that is drawn, in [0, 1]."""

    def __call__(self, splats: Splats) -> Splats:
        """Those that are opaque enough, in the same order."""
        drawn = splats.opacities >= self.opacity
        return splats.take(drawn.nonzero()[:, 0])
