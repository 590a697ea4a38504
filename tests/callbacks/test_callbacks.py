"""What a run leaves behind: curves, images, figures, a log."""

import json
import logging
from dataclasses import replace

import pytest
from PIL import Image
from support.watched_run import SUMMARY, play, report_of, run_info, told_requirements

from gsfw.callbacks.config import AutosaveConfig
from gsfw.callbacks.log import Log
from gsfw.callbacks.progress import Progress
from gsfw.callbacks.results import Results
from gsfw.core.callback import Control
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.run_folder import RunFolder


def test_results_have_a_line_per_logged_step_and_a_final_summary(tmp_path):
    play(Results(), tmp_path)
    folder = RunFolder(tmp_path)
    lines = [json.loads(line) for line in folder.metrics_log.read_text().splitlines()]
    assert [line["step"] for line in lines] == [10, 20, 20]
    assert lines[0]["loss/l1"] == pytest.approx(0.04)
    assert lines[0]["method/share"] == 0.25
    summary = json.loads(folder.summary.read_text())
    assert summary["psnr"] == 30.5
    assert summary["protocol"] == {"background": [1.0, 1.0, 1.0]}
    evaluation = json.loads((folder.evaluations / "step_000000020.json").read_text())
    assert evaluation["per_view"] == [{"name": "v0", "psnr": 30.0}]


def test_results_of_a_stopped_run_claim_no_final_figures(tmp_path):
    play(Results(), tmp_path, summary={"completed": False, "steps": 10})
    assert not RunFolder(tmp_path).summary.exists()


def test_a_resumed_run_does_not_repeat_lines(tmp_path):
    play(Results(), tmp_path, steps=(10, 20), summary={"completed": False})
    play(Results(), tmp_path, steps=(20,), first_step=10)
    lines = RunFolder(tmp_path).metrics_log.read_text().splitlines()
    assert [json.loads(line)["step"] for line in lines] == [10, 20, 20]


def test_the_log_is_for_people_and_lets_go_of_its_file(tmp_path):
    play(Log(10), tmp_path)
    text = RunFolder(tmp_path).log.read_text()
    assert "3dgs on toy started at step 0 of 20" in text
    assert "note: a note" in text
    assert "step 20: 1 held-out views: psnr 30.0000" in text
    assert not logging.getLogger("gsfw").handlers


def test_progress_is_plain_lines_on_standard_error_without_a_terminal(tmp_path, capsys):
    play(Progress(10.0), tmp_path)
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert lines == [
        "note: a note",
        "50%  10/20  --:-- left  PSNR 30.0 dB  loss 0.0500  100 Gaussians  100.0 steps/s  "
        "RAM 0.2 GB",
        "100%  20/20  --:-- left  PSNR 31.0 dB  loss 0.0475  100 Gaussians  100.0 steps/s  "
        "RAM 0.2 GB",
    ]


def test_progress_says_how_small_images_are_while_they_are(tmp_path, capsys):
    progress, control = Progress(10.0), Control()
    progress.on_start(run_info(tmp_path), control)
    progress.on_step(report_of(20, resolution=0.3535), control)
    progress.close()
    assert "PSNR 40.0 dB" in (said := capsys.readouterr().err)
    assert "at 1/2.8 size" in said


def test_slow_steps_between_logged_ones_are_told(tmp_path, capsys):
    run = replace(run_info(tmp_path), settings={"log_every": 10})
    progress, control = Progress(0.0), Control()
    progress.on_start(run, control)
    for step in (10, 11):
        progress.on_tick(step, control)
        if step == 10:
            progress.on_step(report_of(step), control)
    progress.close()
    assert capsys.readouterr().err.splitlines()[-1].startswith("55%  11/20  ")


def test_an_evaluation_of_a_sample_says_of_how_many_views(tmp_path, capsys):
    figures = {"psnr": 30.0, "color_corrected_psnr": 31.0}  # The latter: not without exposures.
    sample = Evaluation(("v0",), (figures,), 1.0, figures, held_out=200)
    for callback in (Progress(10.0), Log(10), Results()):
        callback.on_start(run_info(tmp_path), Control())
        callback.on_evaluation(10, sample, Control())
        callback.close()
    assert "step 10: PSNR 30.00 dB on 1 of 200 held-out views" in capsys.readouterr().err
    folder = RunFolder(tmp_path)
    assert "step 10: 1 of 200 held-out views: psnr 30.0000\n" in folder.log.read_text()
    written = json.loads((folder.evaluations / "step_000000010.json").read_text())
    assert written["protocol"]["sample"] == "1 of 200 held-out views, evenly spread"


def dynamic_evaluation() -> Evaluation:
    curve = tuple({"time": t, "data_time": t, "views": 1, "psnr": 30.0 + t} for t in (0.0, 1.0))
    return Evaluation((), (), 1.0, {"psnr": 30.5}, curve, {"moving_region": "masks"})


@pytest.mark.slow
def test_an_evaluation_over_time_leaves_a_plot_and_says_which_step_it_is_of(tmp_path):
    results, control = Results(), Control()
    results.on_start(run_info(tmp_path), control)
    for step in (10, 20):
        results.on_evaluation(step, dynamic_evaluation(), control)
    results.close()
    folder = RunFolder(tmp_path).evaluations
    assert sorted(path.name for path in folder.iterdir()) == [
        "step_000000010.json", "step_000000010_over_time.png",
        "step_000000020.json", "step_000000020_over_time.png",
    ]  # fmt: skip
    early, last = (json.loads((folder / f"step_0000000{s}.json").read_text()) for s in (10, 20))
    assert early["protocol"]["checkpoint"] == "after step 10 of 20"
    assert "checkpoint" not in last["protocol"]
    assert early["moving_region"] == "masks"
    assert [point["psnr"] for point in early["over_time"]] == [30.0, 31.0]


def test_lists_of_the_summary_are_left_out_of_the_log(tmp_path):
    play(Log(10), tmp_path, summary={**SUMMARY, "over_time": [{"psnr": 30.0}]})
    said = RunFolder(tmp_path).log.read_text()
    assert "ended at step 20" in said
    assert "over_time" not in said


def test_results_keep_what_a_run_required_as_figures_and_as_an_image(tmp_path):
    told_requirements(Results(), tmp_path)
    folder = RunFolder(tmp_path)
    document = json.loads(folder.requirements.read_text())
    assert (document["schema"], document["total_floats"], document["sh_floats"]) == (1, 24, 18)
    assert document["groups"][1] == {
        "name": "SH band 1", "floats": 18, "share": 0.75, "bought_db": 0.25, "how": "so",
    }  # fmt: skip
    assert document["strategy"] == {"why": None}
    with Image.open(folder.requirements_plot) as image:
        assert (image.size, image.getpixel((0, 0))) == ((5, 4), (200, 200, 200))


def test_the_log_has_what_a_run_required_in_a_line(tmp_path):
    told_requirements(Log(10), tmp_path)
    assert "requirements: 48 floats each for colour" in RunFolder(tmp_path).log.read_text()


def test_autosave_asks_for_a_checkpoint_once_the_last_one_is_too_old(tmp_path, monkeypatch):
    now = 1000.0
    monkeypatch.setattr("time.monotonic", lambda: now)
    autosave, control = AutosaveConfig(minutes=2.0).build(), Control()
    autosave.on_start(run_info(tmp_path), control)
    now += 119
    autosave.on_tick(1, control)
    assert not control.checkpoint_requested
    now += 1
    autosave.on_tick(2, control)
    assert control.checkpoint_requested
    control.checkpoint_requested = False
    autosave.on_checkpoint(2, tmp_path / "a.pt")
    now += 60
    autosave.on_tick(3, control)
    assert not control.checkpoint_requested
