"""`gsfw runs compare` shows what differs between runs, from their files alone."""

import json

import pytest
from support.run_files import make_run, refusal

from gsfw.commands.main import main

pytestmark = pytest.mark.usefixtures("empty_folder")


def test_comparison_shows_what_differs(capsys):
    first, second = make_run("a"), make_run("b", psnr=31.5, value=2)
    assert main(["runs", "compare", str(first), str(second)]) == 0
    said = capsys.readouterr()
    lines = [" ".join(line.split()) for line in said.out.splitlines()]
    assert lines[:2] == [f"A {first}", f"B {second}"]
    assert "PSNR 30.00 dB 31.50 dB" in lines
    assert "model 290 kB 290 kB" in lines
    assert "seed 1 2" in lines
    assert "1 more differ, and follow from these (json=true has them)" in lines
    assert not [line for line in lines if line.startswith(("steps", "ssim"))]
    assert said.err == ""


def test_a_run_that_goes_on_is_not_compared_by_the_figures_of_its_earlier_end(capsys):
    runs = [make_run("a"), make_run("b")]
    config = runs[1] / "config.yaml"
    config.write_text(config.read_text().replace("steps: 100", "steps: 200"))
    (runs[1] / "eval" / "step_000000100.json").write_text('{"psnr": 27.0}')
    assert main(["runs", "compare", *map(str, runs), "json=true"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert document["figures"]["psnr"] == [30.0, 27.0]
    assert document["figures"]["model_bytes"] == [290_000, None]
    assert "B is not finished: its figures are those after 100 steps." in said.err


def test_comparison_of_runs_with_other_settings_has_dashes(capsys):
    runs = [make_run("a"), make_run("b", key="new_setting"), make_run("c", done=20)]
    assert main(["runs", "compare", *map(str, runs), "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["settings"]["new_setting"] == [None, 1, None]
    assert document["figures"]["psnr"] == [30.0, 30.0, 30.0]
    assert document["figures"]["ssim"] == [0.9, 0.9, None]
    assert document["chosen"] == ["seed", "new_setting"]


def test_a_setting_that_a_plugin_got_meanwhile_is_named_with_the_packages(capsys):
    first, second = make_run("a"), make_run("b")
    for run, version in ((first, "0.1"), (second, "0.2")):
        with (run / "config.yaml").open("a") as config:
            config.write(f"plugins:\n- my-method {version}\n")
    with (second / "config.yaml").open("a") as config:
        config.write("edge_weight: 0.05\n")
    assert main(["runs", "compare", str(first), str(second)]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[lines.index("no chosen setting differs") :] == [
        "no chosen setting differs",
        "A B",
        "plugins my-method 0.1 my-method 0.2",
        "only B has edge_weight (0.05)",
    ]


def test_settings_of_another_method_are_not_told_one_by_one(capsys):
    first, second = make_run("a"), make_run("b", method="4dgs")
    with (second / "config.yaml").open("a") as config:
        config.write("motion_lr: 0.05\n")
    assert main(["runs", "compare", str(first), str(second)]) == 0
    assert "only B" not in capsys.readouterr().out


def test_figures_that_were_measured_differently_are_not_silently_compared(capsys):
    first, second = make_run("a"), make_run("b")
    summary = second / "metrics.json"
    summary.write_text(summary.read_text().replace('"views": 7', '"views": 9'))
    assert main(["runs", "compare", str(first), str(second)]) == 0
    assert capsys.readouterr().err == (
        "warning: The figures were not measured alike: views 7 in A, 9 in B.\n"
    )


def test_comparison_says_how_large_the_compared_images_were(capsys):
    first, second = make_run("a"), make_run("b")
    for run, sizes in ((first, "[[718, 1280]]"), (second, '[[239, 427]], "downscale": 3.0')):
        summary = run / "metrics.json"
        text = summary.read_text()
        summary.write_text(text.replace('"views": 7', f'"views": 7, "image_sizes": {sizes}'))
    assert main(["runs", "compare", str(first), str(second)]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert main(["runs"]) == 0
    rows = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert " PSNR images Gaussians " in rows[0]
    assert sorted("239 x 427" in row for row in rows[1:]) == [False, True]
    assert "images 718 x 1280 pixels 239 x 427 pixels (1/3 of their size)" in lines


def test_one_run_is_too_few_for_a_comparison(capsys):
    path = make_run("a")
    assert refusal(capsys, "compare", str(path), f"{path}/") == (
        "error: gsfw runs compare: one run is given.\n"
        "Write gsfw runs compare RUN RUN ...; gsfw runs lists them.\n"
    )
