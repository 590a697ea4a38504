"""Cut: a smaller model for export, without Gaussians of little use and without colour bands."""

from __future__ import annotations

from collections.abc import Callable

from gsfw.core.capabilities import check_fit
from gsfw.core.contributions import MEASURES, most_useful_part
from gsfw.core.errors import ConfigError
from gsfw.core.splats import Splats
from gsfw.plugins.automatic import rasterizer_capabilities
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import Restored
from gsfw.plugins.run_source import RunSource, is_dynamic
from gsfw.studies.tradeoff.edits import Kept


def cut(restored: Restored, keep: float, sh_degree: int | None) -> Callable[[Splats], Splats]:
    """Build the function that cuts the splats of a run before they are written.

    Args:
        restored: the run; contributions are measured from its training cameras.
        keep: part of the Gaussians, in (0, 1].
        sh_degree: of what is left of colours; ``None`` for all.

    Raises:
        ConfigError: some are to be left out of a model that moves, or nothing can tell which.
    """
    kept = None if keep == 1 else _most_useful(restored, keep)

    def edit(splats: Splats) -> Splats:
        splats = splats if kept is None else kept(splats)
        return splats if sh_degree is None else splats.up_to(sh_degree)

    return edit


def _most_useful(restored: Restored, keep: float) -> Kept:
    composition = restored.composition
    if is_dynamic(composition):
        raise ConfigError(
            f"keep={keep:g}: the model moves, and what a Gaussian adds differs from time to time.",
            "Leave keep out.",
        )
    name, device = composition.settings.choices["rasterizer"].name, composition.parts.device
    needs = {f"keep={keep:g}": MEASURES}
    check_fit(name, needs, rasterizer_capabilities(installed()), device.type)
    scores = RunSource(restored).contributions()
    if scores is None:  # The rasterizer can measure them.
        raise ConfigError(
            f"keep={keep:g}: the splats of this model do not name their rows.",
            "Leave keep out; or return Splats(..., rows=rows) from splats() of the model.",
        )
    return Kept(most_useful_part(scores.to(device), keep))
