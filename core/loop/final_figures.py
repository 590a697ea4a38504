"""Final figures: the figures of a run that has ended, besides those of its evaluation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gsfw.core.datamanager import Split
from gsfw.core.loop.memory import memory_summary
from gsfw.core.loop.training_parts import TrainingParts
from gsfw.core.team import Team
from gsfw.core.view_dependence import lacking_in_files

if TYPE_CHECKING:
    from gsfw.core.loop.trainer import Trainer


def final_figures(trainer: Trainer, team: Team) -> dict[str, Any]:
    """Steps, time, sizes and memory of a run, as plain data.

    Args:
        trainer: of the run, with all rows of the model in this process.
        team: the processes that have trained it.
    """
    parts, walk = trainer.parts, trainer.walk
    return {
        "num_gaussians": len(parts.table),
        "train_seconds": round(trainer.train_seconds, 3),
        "steps": trainer.step,
        **({} if walk.updates == trainer.step else {"updates": walk.updates}),
        "skipped_steps": trainer.updates.skipped,
        **_sizes(trainer),
        **_lacking_in_files(parts),
        **team.summary(),
        **parts.corrections.summary(),
        "optimizer_bytes": parts.optimizer.num_bytes(),
        **memory_summary(parts.device),
    }


def _sizes(trainer: Trainer) -> dict[str, int | float]:
    """Figures of the model; of a moving scene also the mean bytes of a captured time."""
    parts = trainer.parts
    sizes, times = dict(parts.model.summary()), parts.data.scene.num_times
    if times > 1:
        sizes["bytes_per_time"] = round(sizes["model_bytes"] / times)
    return sizes


def _lacking_in_files(parts: TrainingParts) -> dict[str, bool]:
    """Notes that files of splats hold less than the model; empty for most models."""
    camera = parts.data.views(Split.TRAIN).cameras[0].to(parts.device)
    return dict.fromkeys(lacking_in_files(parts.model, camera), True)
