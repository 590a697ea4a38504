"""Whole runs of method spacetime on the built-in scene that moves."""

import json

import pytest
from support.moving_runs import train
from support.resuming import resumed_to_the_same_bits

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder

# Whole runs; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

SHORT = (
    *("steps=30", "checkpoint_every=15", "eval_every=0"),
    *("strategy.refine_start=4", "strategy.refine_every=10"),
)

ADAPTIVE = ("motion=adaptive", "motion_start=8", "motion_every=10")
"""Before and after the checkpoint that runs are resumed from, and after rows were added."""
RUNS = {
    "default": (),
    "features": ("preset=features",),
    "freetime": ("preset=freetime",),
    "adaptive": ("preset=features", *ADAPTIVE),
    "adaptive and still": (
        *("preset=freetime", "motion_order=3", "spin=true", *ADAPTIVE),
        *("static=auto", "static_start=0", "static_every=3"),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_a_run_resumes_to_the_same_bits(tmp_path, name):
    arguments = ("method=spacetime", *RUNS[name], *SHORT, "seed=3")
    figures = train(tmp_path / "whole", *arguments)
    assert figures["num_gaussians"] != 150, "rows must have been added or removed"
    resumed_to_the_same_bits(tmp_path / "whole")
    if "motion=adaptive" in arguments:
        assert 0 < figures["time_floats"] < figures["time_floats_full"]
        assert figures["rows_of_order_3"] < figures["num_gaussians"]


@pytest.mark.slow
def test_requirements_say_which_parameters_of_time_rows_have(tmp_path):
    run = tmp_path / "run"
    figures = train(run, "method=spacetime", *ADAPTIVE, "steps=20")
    document = json.loads(RunFolder(run).requirements.read_text())
    motion = document["method"]["motion"]
    part = 1 - motion["time_floats"] / motion["time_floats_full"]
    assert motion.pop("left_out") == (
        f"{100 * part:.0f} % of the floats that paths, rotations and times would take"
    )
    assert {name: figures[name] for name in motion} == motion
    assert sum(motion[f"rows_of_order_{order}"] for order in range(4)) == 150
    (time,) = (group for group in document["groups"] if group["name"] == "time parameters")
    assert time["floats"] == motion["time_floats"] < motion["time_floats_full"] == 150 * 15


@pytest.mark.slow
def test_a_model_file_of_rows_of_different_orders_is_drawn_as_its_run(tmp_path):
    run, file = tmp_path / "run", tmp_path / "a.gsfw"
    train(run, "method=spacetime", *ADAPTIVE, "steps=20")
    assert main(["export", str(run), "format=gsfw", f"out={file}"]) == 0
    for path, out in ((run, tmp_path / "run.ply"), (file, tmp_path / "file.ply")):
        assert main(["export", str(path), "time=0.7", f"out={out}"]) == 0
    assert (tmp_path / "run.ply").read_bytes() == (tmp_path / "file.ply").read_bytes()


@pytest.mark.slow
def test_a_run_is_exported_at_any_time(tmp_path):
    run = tmp_path / "run"
    train(run, "method=spacetime", "steps=20")
    assert RunFolder(run).splats.is_file()
    written = []
    for time in (0, 1):
        out = tmp_path / f"at_{time}.ply"
        assert main(["export", str(run), f"time={time}", f"out={out}"]) == 0
        written.append(out.read_bytes())
    assert written[0] != written[1]


def test_views_of_one_time_share_a_step(tmp_path):
    figures = train(tmp_path / "run", "method=spacetime", "steps=5", "sampler=same-time")
    assert figures["skipped_steps"] == 0


@pytest.mark.slow
def test_a_scene_that_moves_is_drawn_better_than_as_if_it_stood_still(tmp_path):
    settings = ("datamanager.views=24", "datamanager.width=48", "datamanager.height=36")
    settings += ("datamanager.points=300", "datamanager.eval_views=4", "steps=600", "eval_every=0")
    still = train(tmp_path / "still", "method=3dgs", "ignore_time=true", *settings)
    moving = train(tmp_path / "moving", "method=spacetime", *settings)
    assert moving["psnr"] > still["psnr"] + 1.5
