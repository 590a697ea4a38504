"""How far the tracks of a run on the built-in moving scene are from the true ones.

    python benchmarks/tracks.py RUN [RUN ...]

prints one JSON object per run. Lengths are in scene units, in which the cameras are about 1 from
their centre. A point keeps its offset from the opaque Gaussian that is nearest to it at time 0.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from gsfw.core.datamanager import Split
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.temporal_metrics.tracks import compare, follow
from gsfw.datamanagers.synthetic.data import SyntheticData
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore

STILL_BELOW = 1e-3
"""Points that never move farther than this stand still, in scene units."""


def track_errors(run: Path) -> dict[str, float | str | int]:
    """Median errors of a run's tracks at the times it was trained on.

    Raises:
        ValueError: the run is not of the built-in scene.
    """
    restored = restore(RunFolder(run), installed())
    parts = restored.composition.parts
    data = parts.data
    if not isinstance(data, SyntheticData):
        raise ValueError(f"{run} is not of the built-in scene, and the truth is not known.")
    times = sorted(set(data.views(Split.TRAIN).times or ()))
    truth = data.tracks(times)
    errors = compare(follow(parts.model, times), truth.positions, truth.present, STILL_BELOW)
    return {
        "run": str(run),
        "method": restored.composition.settings.method.name,
        "num_gaussians": parts.model.num_rows,
        "median_error_moving": errors.moving,
        "median_distance_moved": errors.moved,
        "relative_error_moving": errors.relative,
        "median_error_still": errors.still,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    for folder in parser.parse_args().runs:
        print(json.dumps(track_errors(folder)))  # noqa: T201 - what it is for
