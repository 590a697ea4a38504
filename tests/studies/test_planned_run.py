"""Tests of gsfw.studies.planned_run."""

from dataclasses import replace
from pathlib import Path

import pytest
from support.small_study import TINY, plan, small_study

from gsfw.core.errors import ConfigError
from gsfw.studies.planned_run import data_path, is_missing


def first(tmp_path, **settings):
    return plan(small_study(settings={**TINY, **settings}), tmp_path)[0]


def test_a_run_has_a_folder_of_its_own_and_is_made_by_train(tmp_path):
    run = first(tmp_path)
    assert run.folder.path == tmp_path / "runs" / "balls" / "still" / f"seed-1-{run.fingerprint}"
    assert run.arguments() == [
        "steps=10",
        "datamanager.moving=true",
        "method=3dgs",
        "ignore_time=true",
        "seed=1",
        f"out={run.folder.path}",
    ]
    assert run.steps == 10
    assert run.steps_done() is None
    assert not run.is_finished()


def test_its_fingerprint_is_that_of_all_settings_that_matter(tmp_path):
    usual = first(tmp_path).fingerprint
    assert first(tmp_path, steps=11).fingerprint != usual
    assert first(tmp_path, sh_degree=2).fingerprint != usual
    assert first(tmp_path, checkpoint_every=3, log_every=5, cache_mb=9).fingerprint == usual
    assert first(tmp_path, antialias=False).fingerprint == usual, "that is the default"
    assert first(tmp_path / "elsewhere").fingerprint == usual


def test_a_setting_that_a_result_lacks_counts_where_it_is_not_the_default(tmp_path):
    def comparable(lacks, **settings):
        run = first(tmp_path, **settings)
        stored = {key: value for key, value in run.settings.items() if key != lacks}
        return set(run.settings) - set(run.comparable(stored))

    assert comparable("antialias") == {"antialias"}
    assert comparable("antialias", antialias=False) == {"antialias"}
    assert comparable("antialias", antialias=True) == set()
    assert comparable("strategy") == {"strategy"}
    assert comparable("strategy", strategy="mcmc") == set()


def test_a_wrong_setting_names_the_row_and_the_scene(tmp_path):
    with pytest.raises(ConfigError) as caught:
        first(tmp_path, stepz=3)
    assert str(caught.value) == (
        "row 'still' on scene 'balls': unknown key 'stepz'. Did you mean 'steps'?\n"
        "All keys: gsfw train method=3dgs --help"
    )
    with pytest.raises(ConfigError, match="row 'x' on scene 'balls': no method '4dg'"):
        plan(small_study(rows={"x": {"method": "4dg"}}), tmp_path)
    with pytest.raises(ConfigError, match=r"balls': downscale=0\.5: expected"):
        first(tmp_path, downscale=0.5)


def test_data_is_looked_for_from_the_root(tmp_path):
    (cell,) = small_study(rows={"a": {"data": "robot"}}).cells()
    assert data_path(cell, tmp_path) == tmp_path / "robot"
    assert is_missing(cell, tmp_path)
    (tmp_path / "robot").mkdir()
    assert not is_missing(cell, tmp_path)
    absolute = replace(cell, settings={**cell.settings, "data": "/there"})
    assert data_path(absolute, tmp_path) == Path("/there")
    (built_in,) = small_study(rows={"a": {}}).cells()
    assert data_path(built_in, tmp_path) is None
    assert not is_missing(built_in, tmp_path)
