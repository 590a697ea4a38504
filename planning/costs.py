"""Costs: the number of Gaussians, the memory and the disk that a run will need, about."""

from __future__ import annotations

from gsfw.core.datamanager import Split
from gsfw.core.loop.growth_limit import LIMITS, PER_PIXEL, most_gaussians
from gsfw.core.words import size
from gsfw.planning.trial import tensors_of
from gsfw.plugins.compose import Composition
from gsfw.plugins.memory_fit import MemoryFit

GAUSSIANS_PER_PIXEL = 0.45
"""Gaussians of a finished model per pixel of one view: 0.45 on fox at 359x640 and 0.41 on garden at
648x420, with the default settings of method 3dgs."""
MOST_PER_PIXEL = 2.0
"""The same of models that grow freely, at most: they end with 0.4 to 2."""
GROWTH = 1.05
"""Factor by which a model grows in one refinement, about; MCMC grows by just this."""
PLY_BYTES = 4
"""Bytes of a number in splats.ply, which holds three zeros as normals besides the model's."""
LOG_BYTES = 1000
"""Bytes of a logged step, in metrics.jsonl and TensorBoard; measured."""
IMAGE_BYTES = 2.0
"""Bytes of a pixel in TensorBoard; measured: 1.6 on the built-in scene, 2.1 on fox."""
IMAGES_OF_VIEW = 3
"""Images of a view in TensorBoard: the photo, the render and their difference."""
IMAGES_SHOWN = 4
"""Views that TensorBoard shows of one evaluation."""
CHECKPOINTS_KEPT = 2
"""Checkpoints that a run folder keeps."""


def expected_gaussians(composition: Composition, per_pixel: float = GAUSSIANS_PER_PIXEL) -> int:
    """About how many Gaussians a run ends with.

    A strategy that refines lets them grow by ``GROWTH`` a refinement, up to its own limit and to
    ``per_pixel``, or to its own number per pixel; others leave them as they are.
    """
    start, flat = len(composition.parts.table), composition.settings.flat()
    every = int(flat.get("strategy.refine_every", 0))
    if not every:
        return start
    stop = min(int(flat.get("strategy.refine_stop", 0)), composition.plan.steps)
    rounds = max(0, (stop - 1 - int(flat.get("strategy.refine_start", 0))) // every)
    grown = int(start * GROWTH ** min(rounds, 300))
    budget = str(flat.get("strategy.budget", ""))
    pixels = composition.parts.data.views(Split.TRAIN).pixels
    limits = [most_gaussians(flat, pixels, start)]
    if budget.isdigit():
        limits.append(int(budget))
    if PER_PIXEL in flat:
        grown = limits[0] if rounds else start
    elif not flat.get("strategy.cap_max"):
        limits.append(max(start, int(per_pixel * pixels)))
    return min([grown, *limits])


def memory_mb(composition: Composition) -> float:
    """Megabytes of main memory that a run needs with the Gaussians that it ends with, about."""
    parts = composition.parts
    fit = MemoryFit(composition.settings, parts.data, parts.device)
    return fit.need(expected_gaussians(composition), fit.row(parts.model)).total / 1e6


def most_that_fit(composition: Composition) -> int:
    """About how many Gaussians of a run fit into the memory that is there."""
    parts = composition.parts
    fit = MemoryFit(composition.settings, parts.data, parts.device)
    return fit.most_gaussians(fit.row(parts.model))


def memory_note(composition: Composition) -> tuple[str, ...]:
    """Note on a run that may need more memory than there is; nothing for other runs."""
    parts, settings = composition.parts, composition.settings
    start = len(parts.table)
    grown = max(start, expected_gaussians(composition, MOST_PER_PIXEL))  # A limit removes none.
    fit, most = MemoryFit(settings, parts.data, parts.device), most_that_fit(composition)
    row = fit.row(parts.model)
    if grown <= most:
        return ()
    limit = next((key for key in LIMITS if key in settings.flat()), "")
    way = f" ({limit}={most} ends growth there)" if limit and most > start else ""
    may = "that the model may grow to " if grown > start else ""
    return (
        f"memory may run short: the {grown:,} Gaussians {may}need about "
        f"{size(fit.rows_need(grown, row))}, and {fit.rows_memory}; about {most:,} fit{way}.",
    )


def disk_mb(composition: Composition, state: float, gaussians: int, evaluations: int) -> float:
    """Megabytes of the folder of a run.

    Args:
        composition: of the run.
        state: bytes of a checkpoint at the end.
        gaussians: number at the end.
        evaluations: number of evaluations.
    """
    model = sum(tensor.numel() for tensor in tensors_of(dict(composition.parts.model.state_dict())))
    numbers = gaussians * (model / max(len(composition.parts.table), 1) + 3)
    cameras = composition.parts.data.views(Split.EVAL).cameras[:IMAGES_SHOWN]
    images = sum(camera.width * camera.height for camera in cameras) * IMAGES_OF_VIEW * IMAGE_BYTES
    logged = LOG_BYTES * composition.plan.steps / composition.plan.log_every
    total = CHECKPOINTS_KEPT * state + numbers * PLY_BYTES + images * evaluations + logged
    return total / 1e6
