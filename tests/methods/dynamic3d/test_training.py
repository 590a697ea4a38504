"""Whole runs of method dynamic3dgs on the built-in scene that moves."""

import json

import pytest
from support.moving_runs import MOVING, train
from support.resuming import resumed_to_the_same_bits
from tracks import track_errors

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder

# Whole runs; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

SHORT = (
    *("datamanager.points=400", "method=dynamic3dgs", "steps=42", "eval_every=0", "seed=3"),
    "strategy.grow_gradient=1e-5",
    *("strategy.refine_start=4", "strategy.refine_every=5", "strategy.refine_stop=18"),
)

DYNAMIC = ("4dgs", "4d-rotor", "spacetime", "dynamic3dgs")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first_steps", "step"), [(18, 26), (18, 30), (30, 22)], ids=["between", "amid", "building"]
)
def test_a_run_resumes_to_the_same_bits_wherever_it_was(tmp_path, first_steps, step):
    """After the first, each of the other three times has 8 steps, or 4."""
    arguments = (*SHORT, f"sampler.first_steps={first_steps}", f"checkpoint_every={step}")
    figures = train(tmp_path / "whole", *arguments)
    assert figures["skipped_steps"] == 0
    before, _ = RunFolder(tmp_path / "whole").all_checkpoints()
    assert before == RunFolder(tmp_path / "whole").checkpoint(step)
    resumed_to_the_same_bits(tmp_path / "whole")


@pytest.mark.slow
def test_rows_are_added_at_the_first_time_and_stay_after_it(tmp_path):
    train(tmp_path / "run", *SHORT, "sampler.first_steps=18", "log_every=1")
    log = RunFolder(tmp_path / "run").metrics_log.read_text()
    lines = [json.loads(line) for line in log.splitlines()]
    counts = {line["step"]: line["num_gaussians"] for line in lines if "num_gaussians" in line}
    assert counts[18] != counts[1]
    assert {counts[step] for step in range(18, 43)} == {counts[18]}


@pytest.mark.slow
def test_the_end_of_a_run_states_the_bytes_of_a_captured_time(tmp_path, capsys):
    figures = train(tmp_path / "run", *SHORT, "sampler.first_steps=18")
    said, notes = capsys.readouterr()
    per_time = round(figures["model_bytes"] / 4)
    assert figures["bytes_per_time"] == per_time
    assert f" {per_time / 1e3:.0f} kB for each captured time; " in said
    assert "4 of 4 times have fewer than 4 training views" in notes
    report = json.loads(RunFolder(tmp_path / "run").requirements.read_text())
    assert report["floats_per_time"] == pytest.approx(report["total_floats"] / 4, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "budget"),
    [
        ("dynamic3dgs", "60"),
        *(pytest.param(method, "60", marks=pytest.mark.slow) for method in DYNAMIC[:-1]),
        *(pytest.param(method, "auto", marks=pytest.mark.slow) for method in DYNAMIC),
    ],
)
def test_every_dynamic_method_trains_within_a_budget(tmp_path, method, budget):
    """dynamic3dgs grows at its first time only; rows are removed while it tracks too."""
    arguments = ("steps=80", "eval_every=0", "seed=3", "strategy.grow_gradient=1e-5")
    arguments += ("strategy.refine_start=4", "strategy.refine_every=5", "strategy.refine_stop=20")
    arguments += (f"method={method}", f"strategy.budget={budget}", "strategy.budget_every=5")
    figures = train(tmp_path / "run", *arguments)
    assert figures["completed"]
    assert figures["skipped_steps"] == 0
    if budget != "auto":
        assert figures["num_gaussians"] == 60
    report = json.loads(RunFolder(tmp_path / "run").requirements.read_text())
    assert report["strategy"]["stopped_growing_at"] is not None


def test_a_sampler_that_goes_back_is_refused_without_a_traceback(tmp_path, capsys):
    arguments = ["train", *MOVING, "method=dynamic3dgs", "sampler=uniform", "steps=40"]
    assert main([*arguments, f"out={tmp_path / 'run'}"]) == 2
    said = capsys.readouterr().err
    assert "its sampler (UniformConfig) may go back in time.\nLeave out sampler=, or give" in said
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_surfaces_are_followed_and_drawn_better_than_as_if_they_stood_still(tmp_path):
    """Figures: 21.3 dB after 15.1, and a median error of 19 % of the distance moved (seed 42)."""
    settings = ("datamanager.views=60", "datamanager.times=10", "datamanager.width=120")
    settings += ("datamanager.height=90", "datamanager.points=10000")
    settings += ("datamanager.eval_views=8", "eval_every=0")
    still = train(tmp_path / "still", "method=3dgs", "ignore_time=true", "steps=300", *settings)
    moving = train(tmp_path / "moving", "method=dynamic3dgs", "steps=1000", *settings)
    assert moving["moving_psnr"] > still["moving_psnr"] + 5
    found = track_errors(tmp_path / "moving")
    assert float(found["relative_error_moving"]) < 0.25
    assert float(found["median_error_still"]) < 0.006
