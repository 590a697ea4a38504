"""A run that collapses says so while it trains, in every result, and once."""

import json

import pytest
from support.small_scene import SMALL_SCENE
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder

# Whole runs; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

VANISHING = ("opacity_penalty=1000", "optim.opacities_lr=1", "steps=30", "eval_every=10")
"""All Gaussians become transparent within ten steps."""


@pytest.fixture
def collapsed(trained) -> RunFolder:
    return RunFolder(trained("method=3dgs", *SMALL_SCENE, *VANISHING))


@pytest.mark.slow
def test_a_collapsed_run_does_not_end_like_a_success(tmp_path, capsys):
    out = str(tmp_path / "run")
    assert main(["train", "method=3dgs", *SMALL_SCENE, *VANISHING, f"out={out}"]) == 0
    said = capsys.readouterr()
    assert "\ndone, but not sound: 3dgs on synthetic, 30 steps\n" in said.out
    assert "warning: step 10 of 30: 2 of 2 held-out views are rendered as (nearly) one" in said.err
    assert said.err.count("2 of 2 held-out views are rendered") == 2, "at first, and at the end"
    assert main(["eval", out]) == 0
    assert "warning: 2 of 2 held-out views are rendered as (nearly)" in capsys.readouterr().err


@pytest.mark.slow
def test_its_result_files_name_the_findings(collapsed):
    summary = json.loads(collapsed.summary.read_text())
    assert [item["key"] for item in summary["findings"]] == ["one-color", "dying-gaussians"]
    first = json.loads((collapsed.evaluations / "step_000000010.json").read_text())
    assert first["findings"][0]["collapse"] is True


def test_its_log_says_each_finding_once(collapsed):
    log = collapsed.log.read_text()
    assert log.count("rendered as (nearly) one colour") == 1
    assert "WARNING step 10 of 30: 2 of 2 held-out views" in log


def test_its_curves_have_the_findings_as_text_and_the_baselines(collapsed):
    events = EventAccumulator(str(collapsed.tensorboard))
    events.Reload()
    (page, *_) = events.Tensors("3_findings/text_summary")
    assert b"**one-color**: " in page.tensor_proto.string_val[0]
    curves = {"1_overview/psnr_of_one_color", "2_quality/psnr_of_training_views"}
    assert curves <= set(events.Tags()["scalars"])


def test_a_sound_run_has_baselines_and_no_findings(finished_run):
    folder = RunFolder(finished_run)
    summary = json.loads(folder.summary.read_text())
    assert summary["findings"] == []
    assert summary["baselines"]["constant_psnr"] < summary["psnr"]
    assert summary["training_psnr"] > 0
    assert "not sound" not in folder.log.read_text()


def test_without_held_out_views_the_training_views_are_judged(trained):
    folder = RunFolder(trained("method=3dgs", *SMALL_SCENE, "datamanager.eval_views=0", *VANISHING))
    summary = json.loads(folder.summary.read_text())
    (finding, _) = summary["findings"]
    assert finding["message"].startswith("6 of 6 training views are rendered as (nearly) one")
