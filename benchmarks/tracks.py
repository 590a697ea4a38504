"""Distances of the tracks of a run on the built-in moving scene from the true ones.

    python benchmarks/tracks.py RUN [RUN ...]

prints one JSON object per run. Lengths are in scene units, in which the cameras are about 1 from
their centre. A point keeps its offset from the opaque Gaussian that is nearest to it at time 0.
"""

from __future__ import annotations

import argparse
import json
import sys
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
        ValueError: the run is not of the built-in moving scene.
    """
    restored = restore(RunFolder(run), installed())
    parts = restored.composition.parts
    data = parts.data
    if not isinstance(data, SyntheticData):
        raise ValueError(f"{run} is not of the built-in scene, and the truth is not known.")
    if not data.scene.is_dynamic:
        raise ValueError(f"{run} is of the built-in still scene. Name a run of the moving one.")
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


def main(arguments: list[str]) -> None:
    """Print the errors of the given runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN")
    for folder in parser.parse_args(arguments).runs:
        try:
            sys.stdout.write(json.dumps(track_errors(folder)) + "\n")
        except ValueError as error:
            parser.error(str(error))


if __name__ == "__main__":
    main(sys.argv[1:])
