"""`gsfw tradeoff` without a RUN trains variants, goes on, and recommends a command that holds."""

import csv
import json
import shlex
import sys

import pytest
from support import fake_variants
from support.small_captures import ring, write_images, write_transforms

from gsfw.commands.main import main

TINY = (
    "datamanager.views=6",
    "datamanager.eval_views=2",
    "datamanager.width=64",
    "datamanager.height=48",
    "datamanager.points=150",
)


@pytest.fixture
def quick(monkeypatch):
    """Runs take no time, and are not looked at."""
    command = (sys.executable, "-S", fake_variants.__file__)
    monkeypatch.setattr("gsfw.jobs.process.COMMAND", command)
    experiment = "gsfw.studies.tradeoff.training.experiment.Experiment"
    monkeypatch.setattr(f"{experiment}.is_drawn", True)
    monkeypatch.setattr(f"{experiment}.without_flip", [])


def told(capsys, *words, code=0):
    """What is said on standard output; the error where there is one."""
    capsys.readouterr()
    assert main(["tradeoff", *words]) == code
    said = capsys.readouterr()
    return said.err if code else said.out


def test_without_anything_both_forms_are_told(capsys):
    assert told(capsys, code=2) == (
        "error: gsfw tradeoff: neither a RUN nor settings are given.\n"
        "With a RUN it varies that finished model: gsfw tradeoff latest.\n"
        "With settings and no RUN it trains variants: gsfw tradeoff data=DIR target.psnr=30 "
        "budget.minutes=15.\n"
        "More: gsfw tradeoff --help.\n"
    )
    text = told(capsys, "--help")
    assert "usage: gsfw tradeoff RUN [key=value ...]" in text
    assert "usage: gsfw tradeoff [key=value ...]" in text
    assert "budget.minutes=none" in text


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["stpes=5"], "unknown key 'stpes'. Did you mean 'steps'?"),
        (["minutes=5"], "The time for all variants together is budget.minutes=N."),
        (["target.pnsr=5"], "gsfw tradeoff: unknown key 'target.pnsr'. Did you mean 'target.psnr'"),
        (["method=3dsg"], "Did you mean '3dgs'?"),
        (["axes=size"], "axes=size: there is no such axis."),
        (["jobs=-1"], "jobs=-1: expected a number of at least 0."),
        (["repeats=0"], "repeats=0: expected a number of at least 1."),
        (["budget.minutes=0"], "budget.minutes=0: expected a number above 0."),
        (["data=/nowhere"], "data=/nowhere: there is no such file or folder."),
        (["method=3dgs", "--dry-run"], "unknown key 'dry_run'"),
    ],
)
def test_mistakes_are_told_before_anything_is_trained(tmp_path, capsys, words, said):
    assert said in told(capsys, *words, f"out={tmp_path / 'out'}", code=2)
    assert not (tmp_path / "out" / "runs").exists()


@pytest.mark.slow
def test_a_search_halves_recommends_and_goes_on(tmp_path, capsys, quick):
    words = [*TINY, "steps=400", "sh_degree=1", "axes=sh_degree,cap,steps"]
    words += [f"out={tmp_path}", "target.psnr=24.5", "seed=42"]
    said = told(capsys, *words)
    assert "runs of 100, 200, 400 steps at downscale=1, " in said
    assert "6 views to train on, 2 held out, 64x48 pixels" in said
    document = json.loads((tmp_path / "tradeoff.json").read_text())
    assert document["left"] == 0
    found = {(row["name"], row["steps"]): row for row in document["variants"]}
    assert len(found) == len(document["variants"])
    assert {steps for name, steps in found if name == "baseline"} == {100, 200, 400}
    assert found["cap 1/2", 100]["num_gaussians"] == fake_variants.GAUSSIANS / 2
    assert found["baseline", 400]["changed"] == {}
    assert found["sh_degree=0", 100]["changed"] == {"steps": 100, "sh_degree": 0}
    meeting = [row for row in document["variants"] if row["psnr"] >= 24.5]
    best = min(meeting, key=lambda row: (row["file_mb"], row["train_seconds"]))
    assert document["recommended"]["command"].endswith(best["command"])
    made = (tmp_path / "runs" / "made.txt").read_text().split()
    assert len(made) == len(set(made))
    with (tmp_path / "tradeoff.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(found)
    (tmp_path / "tradeoff.json").unlink()
    again = told(capsys, *words)
    assert " steps: " not in again
    assert (tmp_path / "runs" / "made.txt").read_text().split() == made
    assert json.loads((tmp_path / "tradeoff.json").read_text())["variants"] == list(found.values())


@pytest.mark.slow
def test_time_that_is_over_leaves_runs_for_the_same_command(tmp_path, capsys, quick):
    words = [*TINY, "steps=400", "downscale=1", f"out={tmp_path}", "axes=antialias"]
    error = told(capsys, *words, "budget.minutes=1e-6", code=2)
    assert "no run of the baseline was finished.\nThe same command continues.\n" in error
    said = told(capsys, *words)
    assert "runs are left" not in said
    assert "For a loss of at most 0.10 dB against the baseline: gsfw train " in said


def test_the_folder_of_a_run_is_left_alone(tmp_path, capsys):
    (tmp_path / "config.yaml").touch()
    error = told(capsys, *TINY, f"out={tmp_path}", code=2)
    assert f"error: out={tmp_path}: this folder holds a run.\n" in error
    assert [path.name for path in tmp_path.iterdir()] == ["config.yaml"]


@pytest.mark.slow
def test_a_plan_is_kept_for_the_same_command_only(tmp_path, capsys, quick):
    words, plan = [*TINY, f"out={tmp_path}", "budget.minutes=3", "jobs=1"], tmp_path / "plan.json"
    told(capsys, *words, "axes=antialias")
    first = plan.read_text()
    told(capsys, *words, "axes=antialias")
    assert plan.read_text() == first
    told(capsys, *words, "axes=sh_degree,antialias")
    steps = [json.loads(text)["sizing"]["steps"] for text in (first, plan.read_text())]
    assert steps[1] < steps[0]


@pytest.mark.slow
def test_small_pictures_start_from_few_gaussians_where_nobody_says_how_many(
    tmp_path, capsys, quick
):
    capture = ring(views=9)
    write_images(tmp_path, capture)
    data = write_transforms(tmp_path / "transforms.json", capture).parent
    words = [f"data={data}", "budget.minutes=3", "jobs=1", "axes=antialias"]
    said = told(capsys, *words, f"out={tmp_path / 'chosen'}")
    assert "random_points=1536: more would not improve images of that size" in said
    assert said.count("random_points=1536 ") == 1, "and in the recommended command"
    said = told(capsys, *words, f"out={tmp_path / 'given'}", "random_points=2000")
    assert "random_points=2000 " in said
    assert "more would not improve" not in said


def test_a_baseline_that_fails_says_why(tmp_path, capsys, quick):
    words = [*TINY, "steps=40", f"seed={fake_variants.KILLED}", f"out={tmp_path}"]
    error = told(capsys, *words, "axes=sh_degree", code=2)
    assert "error: the baseline failed: the run was ended from outside by SIGKILL." in error


@pytest.mark.slow
def test_small_pictures_are_judged_in_full_size_and_the_command_holds(tmp_path, capsys):
    words = [*TINY, "steps=30", "axes=resolution", "jobs=1", f"out={tmp_path / 'out'}"]
    assert main(["tradeoff", *words, "target.psnr=10", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    by_name = {row["name"]: row for row in document["variants"]}
    assert set(by_name) == {"baseline", "resolution 1/2", "resolution 1/4"}
    small = next((tmp_path / "out" / "runs").glob("*/resolution-1-4/seed-42-*/metrics.json"))
    metrics = json.loads(small.read_text())
    assert metrics["protocol"]["image_sizes"] == [[16, 12]]
    assert by_name["resolution 1/4"]["psnr"] != metrics["psnr"]
    for row in document["variants"]:
        assert row["render_ms"] > 0
        assert row["peak_memory_mb"] > 50
        assert 0 < row["flip"] < 1
        assert row["floats"] * 4 == row["model_bytes"]
    command = shlex.split(document["recommended"]["command"])
    assert main([*command[1:], f"out={tmp_path / 'again'}", "json=true"]) == 0
    repeated = json.loads((tmp_path / "again" / "metrics.json").read_text())
    chosen = next(r for r in document["variants"] if command[1:] == shlex.split(r["command"]))
    assert repeated["model_bytes"] == chosen["model_bytes"]
    if chosen["name"] == "baseline":
        assert repeated["psnr"] == chosen["psnr"]
