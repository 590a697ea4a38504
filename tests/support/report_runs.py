"""Folders of runs that were never trained: their files are written as a run would write them."""

import json
from collections.abc import Mapping
from pathlib import Path

from gsfw.core.loop.run_folder import RunFolder

CONFIG = """\
schema: 1
gsfw: 0.1.0
torch: 2.9.0
python: 3.11.7
plugins: []
command line: gsfw train method=3dgs steps={steps}
given: [method, steps]
method: 3dgs
strategy: adc
data: ''
steps: {steps}
"""

PROTOCOL = {"split": "eval", "views": 3, "image_sizes": [[32, 24]], "checkpoint": "last"}


def write_run(
    path: Path,
    psnrs: dict[str, float],
    steps: int = 100,
    done: int | None = None,
    each: Mapping[str, float] | None = None,
    **more: object,
) -> RunFolder:
    """A run with these PSNR by view, which has done all of its steps unless ``done`` says less.

    ``each`` is added to the figures of each view, ``more`` to its evaluation and its final figures.
    """
    folder, done = RunFolder(path), steps if done is None else done
    path.mkdir(parents=True, exist_ok=True)
    folder.config.write_text(CONFIG.format(steps=steps))
    mean = sum(psnrs.values()) / max(len(psnrs), 1)
    lines = [{"step": 1 + place, "loss": 1 / (1 + place), "psnr": 10.0} for place in range(done)]
    lines.append({"step": done, "eval/psnr": mean})
    folder.metrics_log.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    figures = {
        "psnr": mean, "render_ms": 2.0, "baselines": {"constant_psnr": 8.0}, "findings": [],
        "protocol": PROTOCOL, **more,
    }  # fmt: skip
    views = [
        {"name": name, "psnr": psnr, "ssim": 0.5, **(each or {})} for name, psnr in psnrs.items()
    ]
    document = {"step": done, **figures, "per_view": views}
    folder.write_json(folder.evaluations / f"step_{done:09d}.json", document)
    if done == steps:
        summary = {"scene": "made", "num_gaussians": 1234, "train_seconds": 5.0, "steps": steps}
        folder.write_json(folder.summary, {**figures, **summary})
    return folder
