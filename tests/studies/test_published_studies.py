"""Tests of benchmarks/studies: every run of every file has settings that a run accepts."""

from pathlib import Path

import pytest
from support.sampling import sampled

from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve
from gsfw.studies.study_file import read_study

# Hundreds of settings are resolved; the tests of settings check types.
pytestmark = pytest.mark.unchecked

FOLDER = Path(__file__).parents[2] / "benchmarks/studies"
DATAMANAGERS = {
    "d-nerf": "blender",
    "dynamic": "blender",
    "hypernerf": "nerfies",
    "neural-3d-video": "neural-3d-video",
    "panoptic": "panoptic",
    "requirements": "colmap",
    "short-runs": "colmap",
}
"""Data manager of the scenes with data, by file."""


def test_every_file_is_tested():
    assert {path.stem for path in FOLDER.glob("*.yaml")} == set(DATAMANAGERS)


@pytest.mark.parametrize("name", sampled([(name,) for name in DATAMANAGERS], daily=(0, 6)))
def test_every_run_of_a_published_study_has_valid_settings(name):
    cells = read_study(FOLDER / f"{name}.yaml").cells()
    # Neither is read here: the data manager is named, and its folder is not opened.
    different = {repr(cell.settings | {"seed": 0, "data": ""}): cell for cell in cells}
    for cell in different.values():
        datamanager = DATAMANAGERS[name] if "data" in cell.settings else "synthetic"
        given = {"device": "cpu", "datamanager": datamanager, **cell.settings}
        resolve(installed(), [Layer("study", given)]).config.check()
