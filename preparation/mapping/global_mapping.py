"""Global mapping: camera poses by GLOMAP, all images at once.

Pan et al. 2024, "Global Structure-from-Motion Revisited". The native call cannot be cancelled, so
that it runs in a process of its own, which can be killed; a copy of the database is worked on,
since focal lengths are first estimated from pairs of images and written into it.
"""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import IO

from gsfw.core.files.atomic import readable_write_errors
from gsfw.preparation.cancellation import PATIENCE
from gsfw.preparation.mapping.incremental_mapping import SEED, SMALLEST, Models, solid
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.native import native_failure

TASK = "compute camera poses at once"
LOG = "log/global-mapping.log"
"""Beside the database, where the advice of native errors leads."""


def run_global(database: Path, folder: Path, rule: MappingRule) -> Models:
    """Compute poses.

    Args:
        database: COLMAP's, with features and verified matches; it is not changed.
        folder: an existing one; models are left in folders below it.
        rule: of which all but the principal point is heeded.

    Returns:
        Models, the largest first; none where nothing could be reconstructed.

    Raises:
        DataError: the process failed; what it said is in ``LOG``.
        OutputError: the log cannot be written.
    """
    from pycolmap import Reconstruction

    copy, log = folder / "database.db", database.parent / LOG
    with closing(sqlite3.connect(database)) as given, closing(sqlite3.connect(copy)) as made:
        given.backup(made)
    # GLOMAP computes all focal lengths, or none.
    refine_focal = rule.refine_focal and not rule.known_cameras
    settings = (str(copy), str(folder), str(rule.jobs), str(int(refine_focal)))
    with readable_write_errors(log):
        log.parent.mkdir(exist_ok=True)
        output = log.open("wb")
    with output:
        code = _wait([sys.executable, "-m", __name__, *settings], output)
    copy.unlink()
    if code != 0:
        raise native_failure(TASK, database, log.read_text("utf-8", errors="replace"))
    return solid(Reconstruction(path.parent) for path in sorted(folder.glob("*/images.bin")))


def _wait(command: list[str], output: IO[bytes]) -> int:
    """Run a process to its end; an exception in this one, such as Ctrl-C, kills it."""
    with subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT) as process:
        while True:
            try:
                return process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                continue
            except BaseException:
                process.kill()
                raise


def _work(database: str, folder: str, jobs: int, refine_focal: bool) -> None:
    """The work of the process."""
    import pycolmap

    pycolmap.set_random_seed(SEED)
    if refine_focal:
        calibration = pycolmap.ViewGraphCalibrationOptions()
        calibration.random_seed = SEED
        pycolmap.calibrate_view_graph(database, calibration)
    options = pycolmap.GlobalPipelineOptions()
    options.num_threads = options.mapper.num_threads = jobs
    options.random_seed = options.mapper.random_seed = SEED
    options.min_model_size = SMALLEST
    options.mapper.bundle_adjustment.refine_focal_length = refine_focal
    options.mapper.refine_sensor_from_rig = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    options.mapper.global_positioning.use_gpu = False
    pycolmap.global_mapping(database, folder, folder, options)


if __name__ == "__main__":
    _work(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4] == "1")
