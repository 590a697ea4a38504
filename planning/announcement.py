"""Announcement: what a planned run will do and need, in the first lines that the user sees."""

from __future__ import annotations

from gsfw.core.datamanager import Split
from gsfw.core.words import duration, rough_size
from gsfw.planning.costs import disk_mb, expected_gaussians, memory_mb
from gsfw.planning.plan import Plan


def announcement(plan: Plan) -> str:
    """Two lines: the time, the steps and the images; memory and disk, about."""
    composition, speed = plan.composition, plan.speed
    config = composition.settings.config
    camera = composition.parts.data.views(Split.TRAIN).cameras[0]
    size = f"images of {camera.width} x {camera.height} pixels"
    if "downscale" in plan.decided:
        size += f", 1/{config.downscale:g} of their size (downscale=1 has full ones)"
    usual = "" if plan.is_asked else " (the usual time; preset=paper has the steps of the paper)"
    step = 1e3 * speed.step * speed.cost(config.downscale)
    memory, disk = needed_mb(plan)
    goal = {"": "", "auto": ", or when more steps stop paying"}.get(
        config.until, f", or at {config.until} dB on {config.held_back} training views held back"
    )
    return (
        f"ends in {duration(60 * plan.asked.minutes)}{goal}{usual}: about {config.steps:,} steps, "
        f"{step:.0f} ms each now; {size}\n"
        f"needs about {memory / 1e3:.1f} GB of memory and {rough_size(1e6 * disk)} of disk"
    )


def needed_mb(plan: Plan) -> tuple[float, float]:
    """Memory of the process and size of its folder at the end, in megabytes, about."""
    composition, speed = plan.composition, plan.speed
    rows = expected_gaussians(composition)
    state = speed.state_bytes * rows / max(speed.gaussians, 1)
    every, steps = composition.plan.eval_every, composition.plan.steps
    evaluations = 1 + ((steps - 1) // every if every else 0)
    return memory_mb(composition), disk_mb(composition, state, rows, evaluations)
