"""The page of a run: what it shows, what it says where something is missing, and its bounds."""

import math
import shutil

import pytest
import torch
from support.report_pages import parsed
from support.report_runs import PROTOCOL, write_run
from support.small_scene import SMALL_SCENE

from gsfw.commands.main import main
from gsfw.core.errors import DataError
from gsfw.core.files.folder_lock import only_one
from gsfw.core.loop.checkpoint_file import checkpoint_environment
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.words import size
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.reports.drawing import DrawingRule
from gsfw.reports.error_image import ErrorImage
from gsfw.reports.page_limit import MOST_BYTES
from gsfw.reports.pictures import stored_pictures
from gsfw.reports.run_reader import read_run
from gsfw.reports.run_report import Opened, write_run_report

PAGE = "report.html"

RULE = DrawingRule(9, 0, ErrorImage(is_flip=False))

NAUGHTY = "<script>alert('x')</script>&\"'.jpg"


@pytest.fixture
def own_run(finished_run, tmp_path):
    """A finished run that a test may change."""
    return shutil.copytree(finished_run, tmp_path / "run")


def page_of(folder):
    """The page of a run without its model."""
    return parsed(write_run_report(folder, Opened(None), RULE))


def test_training_ends_with_a_page_whose_images_decode(finished_run):
    page = parsed(finished_run / PAGE)
    images = page.images()
    assert [image.n_frames for alt, image in images if alt == "Around the scene"] == [24]
    assert len(page.views()) == 2
    assert {image.size for _, image in images} == {(32, 24)}
    shown = [alt.partition(": ")[2] for alt, _ in images if ": " in alt]
    assert shown == ["ground truth", "render", "error"] * 2
    assert "absolute error, mean of the channels" in page.text
    assert (finished_run / PAGE).stat().st_size < MOST_BYTES


def test_the_page_states_its_own_size(finished_run):
    stated = size((finished_run / PAGE).stat().st_size)
    assert (
        f"This file of {stated} holds all it shows and loads nothing."
        in parsed(finished_run / PAGE).text
    )


def test_the_page_has_figures_protocol_curves_settings_and_machine(finished_run):
    text = parsed(finished_run / PAGE).text
    for part in (
        "one colour", "every", "Loss", "held-out views", "Requirements of the scene",
        "gsfw train method=3dgs", "settings that follow from them", "threads", "torch",
    ):  # fmt: skip
        assert part in text, part


def test_the_psnr_has_the_size_of_the_compared_images_beside_it(tmp_path):
    shrunk = {"views": 1, "image_sizes": [[239, 427]], "downscale": 3}
    text = page_of(write_run(tmp_path / "run", {"a": 20.0}, protocol=shrunk)).text
    size = "239 x 427 pixels (1/3 of their size)"
    assert f"PSNR 20.00 dB on 1 held-out view of {size}, 12.0 dB more" in text
    assert f"{size}; one colour 8.00" in text


def test_the_worst_view_is_the_first_one(finished_run, tmp_path):
    record = read_run(RunFolder(finished_run))
    worst = min(record.per_view, key=lambda view: view["psnr"])
    assert parsed(finished_run / PAGE).views()[0] == worst["name"]
    folder = write_run(tmp_path / "made", {"good": 30.0, "bad": 12.5, "fair": 20.0})
    text = page_of(folder).text
    assert text.index("12.50") < text.index("20.00") < text.index("30.00")


@pytest.mark.slow
def test_report_false_writes_no_page_and_all_other_outputs(tmp_path, capsys):
    out = tmp_path / "run"
    assert (
        main(["train", "method=3dgs", *SMALL_SCENE, "steps=2", "report=false", f"out={out}"]) == 0
    )
    assert not (out / PAGE).exists()
    assert not (out / "report").exists()
    for name in ("requirements.json", "requirements.png", "splats.ply", "metrics.json"):
        assert (out / name).is_file(), name
    assert "report.html" not in capsys.readouterr().out


def test_a_run_that_goes_on_writes_its_page_again(own_run):
    (own_run / PAGE).unlink()
    assert main(["resume", str(own_run), "steps=22"]) == 0
    assert "22 steps" in parsed(own_run / PAGE).text


def test_names_and_settings_may_hold_anything(tmp_path):
    folder = write_run(
        tmp_path / "run",
        {NAUGHTY: 20.0},
        findings=[{"key": "x", "collapse": True, "message": NAUGHTY}],
    )
    with folder.config.open("a") as file:
        file.write("odd: |\n  </pre><img src=x onerror=alert(1)>\n")
    folder.log.write_text(f"2026-01-01 00:00:00,000 WARNING {NAUGHTY} http://example.com/x.png\n")
    folder.write_json(folder.requirements, {"headline": NAUGHTY, "groups": [{"name": NAUGHTY}]})
    page = page_of(folder)
    assert len(page.all("script")) == 1
    assert not [image for image in page.all("img") if image.get("src")]
    assert page.text.count(NAUGHTY) >= 4
    assert "</pre><img src=x onerror=alert(1)>" in page.text


def test_a_stopped_run_says_how_far_it_came_and_how_to_go_on(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0}, steps=100, done=40)
    text = page_of(folder).text
    assert "This run is not finished: it has done 40 of 100 steps." in text
    assert f"gsfw resume {folder.path}" in text
    assert "not finished" in text


def test_a_run_that_never_was_evaluated_still_has_a_page(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0}, steps=100, done=40)
    shutil.rmtree(folder.evaluations)
    text = page_of(folder).text
    assert "It was not evaluated yet." in text
    assert "No view was compared." in text


def test_a_run_without_final_figures_says_how_to_make_them(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0})
    folder.summary.unlink()
    text = page_of(folder).text
    assert "All 100 steps are done, but there are no final figures" in text
    assert f"gsfw resume {folder.path}" in text
    assert "it was stopped" not in text


def test_a_later_evaluation_of_a_run_that_was_set_back_does_not_count(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0}, steps=100, done=40)
    folder.write_json(folder.evaluations / "step_000000090.json", {"psnr": 99.0, "per_view": []})
    assert read_run(folder).evaluated_step == 40


@pytest.mark.slow
def test_a_run_without_held_out_views_shows_training_views(tmp_path):
    out = tmp_path / "run"
    scene = [*SMALL_SCENE, "datamanager.eval_views=0"]
    assert main(["train", "method=3dgs", *scene, "steps=2", f"out={out}"]) == 0
    page = parsed(out / PAGE)
    assert len(page.views()) == 6
    assert "Some training views, the worst first" in page.text
    assert "No view is held out" in page.text


def test_where_the_data_is_gone_the_images_of_the_earlier_page_are_shown(own_run, capsys):
    before = stored_pictures(RunFolder(own_run))
    config = own_run / "config.yaml"
    config.write_text(config.read_text().replace("data: ''", "data: /nowhere/capture"))
    assert main(["report", str(own_run)]) == 0
    page = parsed(own_run / PAGE)
    assert "The images are those of an earlier report:" in page.text
    assert "/nowhere/capture" in page.text
    assert "data=PATH" in page.text
    assert f"warning: {own_run} is not drawn anew:" in capsys.readouterr().err
    assert len(page.views()) == 2
    assert stored_pictures(RunFolder(own_run)) == before
    shutil.rmtree(own_run / "report")
    assert main(["report", str(own_run)]) == 0
    assert "There are no images:" in parsed(own_run / PAGE).text


def test_a_page_for_another_place_is_written_where_the_run_cannot_be_written_to(own_run, capsys):
    shutil.rmtree(own_run / "report")
    (own_run / "report").write_text("in the place of the folder")
    out = own_run.with_name("sent.html")
    assert main(["report", str(own_run), f"out={out}", "frames=0"]) == 0
    assert len(parsed(out).views()) == 2
    warned = capsys.readouterr().err
    assert "cannot be written: " in warned
    assert "The images are not kept for images=stored." in warned
    (own_run / PAGE).unlink()
    (own_run / PAGE).mkdir()
    assert main(["report", str(own_run), "frames=0"]) == 2
    assert "Choose another place with out=FILE.\n" in capsys.readouterr().err


def test_a_page_goes_into_the_folder_that_is_given(own_run):
    given = ["report", str(own_run), "images=stored", f"out={own_run.with_name('sent')}/"]
    assert main(given) == 0
    assert main(["report", str(own_run), *given[1:]]) == 0
    names = sorted(path.name for path in own_run.with_name("sent").iterdir())
    assert names == ["comparison.html", PAGE]


def test_an_image_that_goes_while_the_page_is_drawn_costs_images_and_not_the_page(
    own_run, monkeypatch
):
    def fails(*arguments):
        raise DataError("/data/0001.jpg: there is no such image.", "Give the data set with data=.")

    monkeypatch.setattr("gsfw.reports.run_report.draw_pictures", fails)
    monkeypatch.setattr("gsfw.reports.comparison.draw_pictures", fails)
    assert main(["report", str(own_run)]) == 0
    text = parsed(own_run / PAGE).text
    assert "The images are those of an earlier report: /data/0001.jpg: there is no such" in text
    out = own_run / "both.html"
    shutil.copytree(own_run, own_run.with_name("other"))
    runs = [str(own_run), str(own_run.with_name("other"))]
    assert main(["report", *runs, f"out={out}"]) == 0
    assert "its images are those of an earlier report: /data/0001.jpg" in parsed(out).text


@pytest.mark.parametrize("name", ["metrics.json", "requirements.json", "eval/step_000000100.json"])
@pytest.mark.parametrize("content", ['{"psnr": 1', "[1, 2]", "", "\x00\xff"])
def test_a_damaged_file_is_left_out_with_a_sentence(tmp_path, name, content):
    folder = write_run(tmp_path / "run", {"a": 20.0})
    (folder.path / name).write_text(content, encoding="latin-1")
    text = page_of(folder).text
    assert text.count(f"{name.rpartition('/')[2]} ") == 1
    assert "left out" in text


def test_where_figures_of_views_are_lost_nobody_says_that_none_are_held_out(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0}, views=1)
    (folder.evaluations / "step_000000100.json").write_text("{")
    text = page_of(folder).text
    assert "PSNR 20.00 dB on 1 held-out view of 32 x 24 pixels, 12.0 dB more than an image" in text
    assert "No view is held out" not in text


def test_a_damaged_log_ends_the_curves(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0})
    lines = folder.metrics_log.read_text().splitlines()
    folder.metrics_log.write_text("\n".join([*lines[:30], '{"step": 31, "lo', *lines[31:]]))
    text = page_of(folder).text
    assert "metrics.jsonl is damaged at line 31: the curves end before it." in text


def test_odd_values_in_result_files_are_no_error(tmp_path):
    views = [
        {"name": "a", "psnr": None}, {"psnr": 3.0}, "b", {"name": 7, "psnr": math.inf},
        {"name": ["c"], "psnr": 10**400},
    ]  # fmt: skip
    folder = write_run(tmp_path / "run", {})
    document = {
        "step": 100, "psnr": "high", "per_view": views, "baselines": [], "findings": 3,
        "over_time": [{"data_time": 0.0, "psnr": 1.0}, 5], "protocol": "none",
    }  # fmt: skip
    folder.write_json(folder.evaluations / "step_000000100.json", document)
    folder.write_json(
        folder.requirements, {"groups": [3, {"share": "x"}], "motion": 1, "measured": 0}
    )
    assert "made" in page_of(folder).text


def test_without_images_the_views_are_listed_and_not_folded(tmp_path):
    folder = write_run(tmp_path / "run", {f"view {place}": 20.0 + place for place in range(7)})
    page = page_of(folder)
    assert "more views" not in page.text
    assert "view 6 26.00" in page.text
    assert "There are no images." in page.text


def test_damaged_settings_leave_the_rest(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0})
    folder.config.write_text("method: [")
    text = page_of(folder).text
    assert "Settings are left out." in text
    assert "20.00" in text


@pytest.mark.slow
def test_thousands_of_views_and_steps_stay_within_the_bound(tmp_path):
    psnrs = {f"{place:05d}{'x' * 60}.jpg": 10.0 + place / 100 for place in range(3000)}
    folder = write_run(tmp_path / "run", psnrs, steps=30_000)
    page = page_of(folder)
    assert (folder.path / PAGE).stat().st_size < 1_000_000
    assert "2,600 better views are left out." in page.text


def test_long_texts_of_files_do_not_make_a_page_large(tmp_path):
    findings = [{"key": "x", "collapse": False, "message": "word " * 1_000_000}]
    folder = write_run(tmp_path / "run", {"a": 20.0}, findings=findings)
    with folder.config.open("a") as file:
        file.write(f"long: {'x' * 3_000_000}\n")
    page = page_of(folder)
    assert (folder.path / PAGE).stat().st_size < 100_000
    assert "... (5,000,000 characters)" in page.text
    assert "... (3,000,000 characters)" in page.text


def test_views_that_were_not_asked_for_are_not_called_left_out(own_run):
    assert main(["report", str(own_run), "views=1", "frames=0"]) == 0
    page = parsed(own_run / PAGE)
    assert len(page.views()) == 1
    assert "Left out" not in page.text
    assert "left out for its size" not in page.text
    assert "views=N" in page.text


def test_a_view_is_called_the_median_one_only_where_errors_are_known(own_run):
    captions = {alt for alt, _ in parsed(own_run / PAGE).images()}
    assert [c for c in captions if c.startswith("Render of the median view, ")]
    shutil.rmtree(own_run / "eval")
    assert main(["report", str(own_run), "frames=0"]) == 0
    captions = {alt for alt, _ in parsed(own_run / PAGE).images()}
    assert [c for c in captions if c.startswith("Render of ")]
    assert not [c for c in captions if "median" in c]


def test_a_run_in_training_says_so_and_not_that_it_was_stopped(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0}, steps=100, done=40)
    with only_one(folder.path, "nobody"):
        text = page_of(folder).text
    assert "This run is in training: it has done 40 of 100 steps." in text
    assert "gsfw resume" not in text


def test_a_finished_run_that_never_was_evaluated_says_how_to_measure_it(tmp_path):
    folder = write_run(tmp_path / "run", {}, psnr=None, views=7)
    shutil.rmtree(folder.evaluations)
    text = page_of(folder).text
    assert f"This run was not evaluated. Measure it with: gsfw eval {folder.path}" in text
    assert "No view is held out" not in text


def test_metrics_of_plugins_have_tiles_and_columns(tmp_path):
    each = {"my_metric": 0.75}
    folder = write_run(tmp_path / "run", {"a": 20.0}, each=each, my_metric=0.25)
    text = page_of(folder).text
    assert "my metric 0.2500" in text
    assert "0.7500" in text


@pytest.mark.slow
def test_images_of_a_method_are_beside_those_of_its_views(own_run, monkeypatch):
    def view_images(method, context):
        return {"cover_age": context.rendered.alpha[0].expand(-1, -1, 3)}

    monkeypatch.setattr(StaticGaussiansMethod, "view_images", view_images)
    shutil.rmtree(own_run / "report", ignore_errors=True)
    assert main(["report", str(own_run)]) == 0
    found = stored_pictures(RunFolder(own_run))
    assert found is not None
    assert all([*view.own] == ["cover_age"] for view in found.views)
    assert (own_run / PAGE).read_text().count('data-kind="cover age"') == len(found.views) > 0


@pytest.mark.parametrize("more", [{}, {"exposure": "learnt for training images"}])
def test_corrected_colors_have_a_tile_and_a_column_where_exposures_were_learnt(tmp_path, more):
    each, protocol = {"color_corrected_psnr": 21.75}, {**PROTOCOL, **more}
    folder = write_run(
        tmp_path / "run", {"a": 20.0}, each=each, color_corrected_psnr=21.25, protocol=protocol
    )
    text = page_of(folder).text
    shown = ["colour-corrected PSNR" in text, "21.25" in text, "21.75" in text]
    assert shown == [bool(more)] * 3


def test_where_the_last_evaluation_is_lost_the_final_figures_count(tmp_path):
    folder = write_run(tmp_path / "run", {"a": 20.0})
    folder.write_json(folder.evaluations / "step_000000050.json", {"psnr": 12.0, "per_view": []})
    (folder.evaluations / "step_000000100.json").write_text("{")
    assert read_run(folder).figure("psnr") == 20.0


def test_the_machine_of_a_checkpoint_is_read_without_its_tensors(finished_run, tmp_path):
    latest = RunFolder(finished_run).latest_checkpoint()
    assert checkpoint_environment(latest)["torch"] == str(torch.__version__)
    damaged = tmp_path / "step_1.pt"
    damaged.write_bytes(latest.read_bytes()[:100])
    assert checkpoint_environment(damaged) == {}


def test_figures_of_a_moving_scene_have_their_curve_over_time(tmp_path):
    points = [{"data_time": t / 4, "psnr": 20.0 + t, "moving_psnr": 10.0 + t} for t in range(5)]
    folder = write_run(tmp_path / "run", {"a": 20.0}, over_time=points, moving_psnr=12.0)
    page = page_of(folder)
    labels = [svg["aria-label"] for svg in page.all("svg")]
    assert "PSNR of held-out views over time: all pixels, moving pixels" in labels
    assert "PSNR of the moving region" in page.text


@pytest.mark.slow
def test_a_failure_of_the_report_does_not_fail_the_run(tmp_path, monkeypatch, capsys):
    def fails(*arguments):
        raise RuntimeError("no such colour")

    monkeypatch.setattr("gsfw.reports.run_report.draw_pictures", fails)
    out = tmp_path / "run"
    assert main(["train", "method=3dgs", *SMALL_SCENE, "steps=2", f"out={out}"]) == 0
    assert "no report was written: RuntimeError: no such colour" in capsys.readouterr().err
    assert RunFolder(out).summary.is_file()
