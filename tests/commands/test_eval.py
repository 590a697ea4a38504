"""`gsfw eval` repeats a run's own figures, picture by picture."""

import json
import re
import shutil

import pytest
import torch

from gsfw.commands.eval import _rows, _show_views, _shown, natural
from gsfw.commands.interface.console import Console
from gsfw.commands.main import main
from gsfw.core.loop.evaluation import Evaluation
from gsfw.core.loop.run_folder import RunFolder


@pytest.fixture
def run(finished_run, tmp_path):
    """A copy that may be changed."""
    return shutil.copytree(finished_run, tmp_path / "run")


def test_eval_repeats_the_figures_the_run_ended_with(run, capsys):
    assert main(["eval", str(run), "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    summary = json.loads(RunFolder(run).summary.read_text())
    assert document["psnr"] == summary["psnr"]
    assert document["ssim"] == summary["ssim"]
    assert document["protocol"] == summary["protocol"]
    assert document["color_corrected_psnr"] == summary["color_corrected_psnr"]
    assert [view["name"] for view in document["per_view"]] == ["eval_000", "eval_001"]
    written = RunFolder(run).evaluations / "step_000000020.json"
    assert json.loads(written.read_text())["psnr"] == summary["psnr"]


def test_the_views_it_was_trained_on_can_be_evaluated_too(run, capsys):
    assert main(["eval", str(run), "split=train"]) == 0
    out = capsys.readouterr().out
    assert "train_005" in out
    assert "mean" in out
    assert (RunFolder(run).evaluations / "step_000000020_train.json").is_file()


def test_a_budget_draws_fewer_gaussians_than_the_model_has_rows(run, capsys):
    assert main(["eval", str(run), "budget=50", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["psnr"] < json.loads(RunFolder(run).summary.read_text())["psnr"]


def test_the_figures_are_printed_where_the_run_cannot_be_written_to(run, capsys):
    shutil.rmtree(run / "eval")
    (run / "eval").write_text("in the place of the folder")
    assert main(["eval", str(run)]) == 0
    said = capsys.readouterr()
    psnr = json.loads(RunFolder(run).summary.read_text())["psnr"]
    assert f"{psnr:.2f} dB" in said.out
    assert "files" not in said.out
    assert f"warning: {run / 'eval' / 'step_000000020.json'} cannot be written: " in said.err
    assert "The figures are printed only; json=true prints all of them.\n" in said.err
    assert "out=" not in said.err


def test_a_folder_that_is_no_run_is_refused(tmp_path, capsys):
    assert main(["eval", str(tmp_path)]) == 2
    assert "is not a run: it has no config.yaml" in capsys.readouterr().err


def test_an_unknown_split_names_the_ones_there_are(run, capsys):
    assert main(["eval", str(run), "split=test"]) == 2
    assert "expected one of eval, train, found 'test'" in capsys.readouterr().err


def test_a_run_can_be_evaluated_on_another_device_than_it_was_trained_on(run, capsys):
    config = run / "config.yaml"
    text = config.read_text().replace("device: cpu", "device: cuda")
    config.write_text(re.sub("rasterizer: .*", "rasterizer: cuda", text))
    if not torch.cuda.is_available():
        assert main(["eval", str(run)]) == 2
        assert "device" in capsys.readouterr().err
    # The rasterizer of the GPU does not draw on a CPU: another one is found.
    assert main(["eval", str(run), "device=cpu"]) == 0
    assert main(["export", str(run), "device=cpu"]) == 0


def test_numbers_in_names_sort_as_numbers():
    names = ["r_100", "r_2", "r_10", "r_1", "a_3"]
    assert sorted(names, key=natural) == ["a_3", "r_1", "r_2", "r_10", "r_100"]


def test_the_worst_images_are_named_and_those_in_the_table_are_sorted_by_number(capsys):
    figures = [{"psnr": 20.0 + number} for number in range(12)]
    views = tuple(f"r_{number}" for number in range(12))
    evaluation = Evaluation(views, tuple(figures), 1.0, {"psnr": 25.5})
    _show_views(Console(), evaluation, "title")
    out = capsys.readouterr().out
    assert out.index("r_2 ") < out.index("r_10 ")
    (worst,) = (row for row in _rows(evaluation, "12 views") if row.name == "worst")
    assert worst.value == "20.00 dB"
    assert worst.remark == "PSNR: r_0 20.00, r_1 21.00, r_2 22.00, r_3 23.00, r_4 24.00"


def test_the_summary_ends_with_the_file_and_the_next_commands(run, capsys):
    assert main(["eval", str(run)]) == 0
    out = capsys.readouterr().out
    assert f"\n\n{run} after 20 steps\n\n  PSNR " in out
    views = r"2 held-out views of \d+ x \d+\s+pixels"
    assert re.search(rf"^{run}, step 20: {views}$", out, re.MULTILINE)
    assert re.search(rf"mean of {views}; one colour has ".replace(" ", r"\s+"), out)
    assert re.search(rf"\n  files +{run}/eval/step_000000020.json\n  next +gsfw ", out)
    assert f"gsfw render {run}\n" in out
    assert "corrected" not in out


def test_colour_corrected_figures_are_shown_of_runs_that_learnt_exposures(capsys):
    figures = {"psnr": 20.0, "color_corrected_psnr": 21.5}
    whole = Evaluation(("a",), (figures,), 1.0, figures)
    for protocol, is_there in (({}, False), ({"exposure": "learnt"}, True)):
        shown = _shown(whole, protocol)
        _show_views(Console(), shown, "title")
        assert ("21.5000" in capsys.readouterr().out) == is_there
        assert ("21.50 dB" in [row.value for row in _rows(shown, "1 view")]) == is_there
