"""The expected costs of a run: what is guessed, and how near it comes to a run."""

import json
from dataclasses import replace

import pytest

from gsfw.commands.main import main
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve
from gsfw.studies import expectation
from gsfw.studies.expectation import expect, expected_gaussians

SCENE = {
    "method": "3dgs",
    "device": "cpu",
    "datamanager.views": "4",
    "datamanager.eval_views": "2",
    "datamanager.width": "40",
    "datamanager.height": "30",
    "datamanager.points": "300",
}


def composed(**changes):
    values = {**SCENE, **{key.replace("__", "."): text for key, text in changes.items()}}
    return compose(resolve(installed(), [Layer(COMMAND_LINE, values)]), installed())


def test_only_strategies_that_refine_are_expected_to_add_gaussians():
    assert expected_gaussians(composed(strategy="none")) == 300
    # 28 refinements of 5 % each, but not over what the pixels of a view can use.
    assert expected_gaussians(composed(steps="3000")) == int(0.45 * 40 * 30)
    # A number per pixel is reached in any number of refinements.
    assert expected_gaussians(composed(steps="3000", strategy="error")) == int(0.8 * 40 * 30)
    # Too short a run refines nothing.
    assert expected_gaussians(composed(steps="100")) == 300


def test_limits_and_budgets_are_not_exceeded():
    assert expected_gaussians(composed(steps="3000", strategy__max_gaussians="400")) == 400
    assert expected_gaussians(composed(steps="3000", strategy__budget="350")) == 350
    grown = expected_gaussians(composed(steps="3000", strategy="mcmc", strategy__cap_max="900"))
    assert grown == 900


@pytest.mark.slow
def test_an_expectation_counts_steps_and_rows_and_writes_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    short = expect(composed(steps="100"), installed(), 0.0)
    long = expect(composed(steps="3000"), installed(), 0.0)
    assert long.gaussians == 540
    assert long.seconds > 2900 * min(long.step_seconds, long.last_step_seconds)
    assert short.seconds < long.seconds
    assert short.disk_mb < long.disk_mb
    assert short.memory_mb > 100
    assert short.gpu_memory_mb is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_model_that_starts_at_random_has_no_points_to_add_to():
    start = expect(composed(datamanager__points="0", random_points="200"), installed(), 0.0)
    assert start.gaussians >= 200
    assert start.last_step_seconds >= start.step_seconds


@pytest.mark.slow
def test_the_expected_disk_is_about_that_of_the_run(tmp_path, capsys):
    settings = [f"{key}={text}" for key, text in SCENE.items()]
    run = ["train", *settings, "steps=40", f"out={tmp_path / 'run'}", "json=true"]
    assert main([*run, "dry_run=true"]) == 0
    expected = json.loads(capsys.readouterr().out)["expected"]
    assert main(run) == 0
    files = sum(path.stat().st_size for path in (tmp_path / "run").rglob("*") if path.is_file())
    state = sum(path.stat().st_size for path in (tmp_path / "run" / "checkpoints").iterdir())
    assert state / 1e6 < expected["disk_mb"] < 2 * files / 1e6


def test_an_expectation_reads_as_a_sentence():
    found = expectation.Expectation(40_000, 170.0, 0.045, 0.0604, 1240.0, None, 45.2)
    assert str(found) == (
        "expected on this machine: 2 min 50 s, 1.2 GB of memory, 45 MB of disk, if the model grows "
        "to 40,000 Gaussians (45 ms a step now, 60 ms then)"
    )
    assert "1.2 GB of memory and 3.5 GB of GPU" in str(replace(found, gpu_memory_mb=3500.0))
