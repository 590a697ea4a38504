"""Several runs on one page: names, common views, and what makes figures incomparable."""

import numpy as np
import pytest
from support.report_pages import parsed
from support.report_runs import PROTOCOL, write_run
from support.small_scene import SMALL_SCENE

from gsfw.commands.main import main
from gsfw.reports.comparison import ComparedRun, common_views, labels, write_comparison
from gsfw.reports.drawing import DrawingRule
from gsfw.reports.encoding import webp
from gsfw.reports.error_image import ErrorImage
from gsfw.reports.page_limit import MOST_BYTES
from gsfw.reports.pictures import Pictures, ViewPicture, store_pictures
from gsfw.reports.provenance import settings_section
from gsfw.reports.run_comparison import QUALITY, RunComparison
from gsfw.reports.run_reader import read_run
from gsfw.reports.run_report import Opened

RULE = DrawingRule(6, 0, ErrorImage(is_flip=False))


def record(path, psnrs, **more):
    return read_run(write_run(path, psnrs, **more))


def noise_webp(side):
    """A square image that fills many bytes."""
    pixels = np.random.default_rng(0).integers(0, 256, (side, side, 3), dtype=np.uint8)
    return webp(pixels, 480_000)


def reasons(*records):
    return RunComparison(records).why_not("xyz"[: len(records)])


def stored(*names):
    return Pictures(1, "eval", "", tuple(ViewPicture(n, "", 1.0, b"", b"", b"") for n in names))


@pytest.mark.slow
def test_two_runs_share_a_page_with_their_views_side_by_side(trained, tmp_path, capsys):
    runs = [str(trained("method=3dgs", *SMALL_SCENE, f"steps={steps}")) for steps in (20, 10)]
    out = tmp_path / "both.html"
    assert main(["report", *runs, "frames=4", f"out={out}"]) == 0
    page = parsed(out)
    slides = [image for image in page.all("img") if "data-run" in image]
    assert [image["data-run"] for image in slides] == ["0", "1", "2"] * 2
    assert [image.get("class") for image in slides[:3]] == ["left", "right", None]
    assert len(page.all("select")) == 2
    assert len(page.images()) == len(slides) + 2
    assert "steps" in page.text
    assert f"report: {out} (" in capsys.readouterr().out


def test_views_come_first_whose_psnr_differs_most(tmp_path):
    one = record(tmp_path / "one", {"a": 20.0, "b": 20.0, "c": 20.0, "d": 20.0})
    two = record(tmp_path / "two", {"a": 21.0, "b": 12.0, "c": 20.5})
    runs = [ComparedRun(item, Opened(None), stored("a", "b", "c", "d")) for item in (one, two)]
    assert common_views(runs, 3) == ["b", "a", "c"]
    assert common_views([runs[0], ComparedRun(two, Opened(None), stored("z"))], 2) == []


def test_the_best_of_each_row_is_marked_and_ties_are_not(tmp_path):
    one = record(tmp_path / "one", {"a": 20.0}, ssim=0.5)
    two = record(tmp_path / "two", {"a": 25.0}, ssim=0.5)
    out = write_comparison([(one, Opened(None)), (two, Opened(None))], RULE, tmp_path / "c.html")
    text = out.read_text()
    assert '<td class="best">25.00 dB</td>' in text
    assert text.count('class="best"') == 1
    assert "No view has images in all of these runs." in parsed(out).text


def test_figures_that_were_measured_otherwise_are_called_incomparable(tmp_path):
    one = record(tmp_path / "one", {"a": 20.0})
    two = record(tmp_path / "two", {"a": 20.0}, protocol={**PROTOCOL, "image_sizes": [[64, 48]]})
    assert reasons(one, one) == []
    assert reasons(one, two) == [
        "The figures were not measured alike: image sizes 32 x 24 in x, 64 x 48 in y."
    ]


def test_without_a_common_measure_no_run_is_called_better(tmp_path):
    one = record(tmp_path / "one", {"a": 20.0})
    others = {
        "is not finished": record(tmp_path / "two", {"a": 25.0}, done=40),
        "image sizes 32 x 24 in one, 64 x 48 in three": record(
            tmp_path / "three", {"a": 25.0}, protocol={**PROTOCOL, "image_sizes": [[64, 48]]}
        ),
        "was not evaluated": record(tmp_path / "four", {"a": 25.0}, protocol=None),
    }
    for reason, other in others.items():
        runs = [(one, Opened(None)), (other, Opened(None))]
        out = write_comparison(runs, RULE, tmp_path / "c.html")
        page = parsed(out)
        assert reason in page.text
        assert "so none is marked as the better one." in page.text
        assert not page.all("td", "best")
        assert "Green:" not in page.text


def test_times_are_marked_only_between_equal_machines(tmp_path):
    runs = [
        record(tmp_path / name, {"a": 20.0}, render_ms=ms) for name, ms in (("x", 1.0), ("y", 2.0))
    ]
    comparison = RunComparison(tuple(runs))
    render = next(figure for figure in comparison.figures if figure.key == "render_ms")
    assert comparison.best(render) == [False, False], "nothing is known of the machines"
    for run, threads in zip(runs, (2, 2), strict=True):
        run.__dict__["environment"] = {"device": "cpu", "threads": threads}
    assert RunComparison(tuple(runs)).best(render) == [True, False]
    runs[1].__dict__["environment"] = {"device": "cpu", "threads": 8}
    assert RunComparison(tuple(runs)).best(render) == [False, False]


def test_a_run_that_goes_on_after_its_end_is_not_judged_by_its_old_figures(tmp_path):
    folder = write_run(tmp_path / "one", {"a": 30.0}, ssim=0.9, model_bytes=1000)
    folder.config.write_text(folder.config.read_text().replace("steps: 100", "steps: 200"))
    folder.write_json(folder.evaluations / "step_000000150.json", {"psnr": 31.0})
    with folder.metrics_log.open("a") as file:
        file.write('{"step": 150, "num_gaussians": 77, "step_ms": 10.0}\n')
    other = record(tmp_path / "two", {"a": 32.0})
    comparison = RunComparison((read_run(folder), other))
    values = {figure.key: values[0] for figure, values in comparison.figures.items()}
    assert values["psnr"] == 31.0
    assert values["num_gaussians"] == 77
    assert "model_bytes" not in values
    assert "ssim" not in values
    assert not comparison.is_comparable


def test_what_is_nearly_as_good_is_marked_too_and_nothing_where_all_are(tmp_path):
    def marks(*psnrs):
        runs = [record(tmp_path / f"{i}", {"a": psnr}) for i, psnr in enumerate(psnrs)]
        comparison = RunComparison(tuple(runs))
        return comparison.best(QUALITY[0])

    assert marks(20.0, 20.04, 19.0) == [True, True, False]
    assert marks(20.0, 20.04) == [False, False]
    assert marks(20.0, 20.1) == [False, True]


def test_the_head_of_a_comparison_names_the_best_run(tmp_path):
    runs = [(record(tmp_path / name, {"a": psnr}), Opened(None))
            for name, psnr in (("one", 20.0), ("two", 25.5), ("three", 24.0))]  # fmt: skip
    text = parsed(write_comparison(runs, RULE, tmp_path / "c.html")).text
    assert "two has the best PSNR, 25.50 dB: 1.50 dB more than three." in text
    same = write_comparison([runs[0], runs[0]], RULE, tmp_path / "same.html")
    assert "has the best PSNR" not in same.read_text()


def test_metrics_of_plugins_are_compared_without_a_better_side(tmp_path):
    runs = []
    for name, value in (("one", 0.25), ("two", 0.5)):
        own = {"my_metric": value}
        runs.append(read_run(write_run(tmp_path / name, {"a": 20.0}, each=own, **own)))
    comparison = RunComparison(tuple(runs))
    found = next(figure for figure in comparison.figures if figure.key == "my_metric")
    assert found.name == "my metric"
    assert [found.text(value) for value in comparison.figures[found]] == ["0.2500", "0.5000"]
    assert comparison.best(found) == [False, False]


def measured_run(path, corrected: float, **protocol: str):
    """A run whose view has a colour-corrected PSNR."""
    each = {"color_corrected_psnr": corrected}
    return read_run(
        write_run(path, {"a": 20.0}, each=each, **each, protocol={**PROTOCOL, **protocol})
    )


def test_corrected_colors_are_compared_where_a_run_learnt_exposures(tmp_path):
    plain, other = (measured_run(tmp_path / name, 21.0) for name in ("plain", "other"))
    exposed = measured_run(tmp_path / "exposed", 23.0, exposure="learnt for training images")
    names = [figure.name for figure in RunComparison((plain, other)).figures]
    assert "colour-corrected PSNR" not in names
    comparison = RunComparison((plain, exposed))
    found = next(f for f in comparison.figures if f.name == "colour-corrected PSNR")
    assert comparison.figures[found] == [21.0, 23.0]
    assert comparison.best(found) == [False, True]


@pytest.mark.slow
def test_a_comparison_with_large_stored_films_stays_within_the_bound(tmp_path):
    film, image = (noise_webp(side) for side in (800, 400))
    assert 400_000 < len(film) < 480_000
    runs = []
    for place in range(6):
        folder = write_run(tmp_path / str(place), {"a": 20.0 + place})
        views = (ViewPicture("a", "", 20.0, image, image, image),)
        store_pictures(folder, Pictures(100, "eval", "absolute", views, orbit=film))
        runs.append((read_run(folder), Opened(None)))
    out = write_comparison(runs[:2], RULE, tmp_path / "two.html")
    assert "Left out" not in out.read_text()
    out = write_comparison(runs, RULE, tmp_path / "six.html")
    assert out.stat().st_size <= MOST_BYTES
    assert "Left out, to stay below 4.0 MB: the film." in out.read_text()
    assert out.read_text().count("data-run=") == 7


def test_the_same_data_at_another_place_is_no_difference(tmp_path):
    runs = []
    for place in ("/here/fox", "/there/fox", "/here/plush"):
        folder = write_run(tmp_path / place.replace("/", "_"), {"a": 20.0})
        folder.config.write_text(folder.config.read_text().replace("data: ''", f"data: {place}"))
        runs.append(read_run(folder))
    assert reasons(*runs[:2]) == []
    assert "data fox in x, plush in y." in reasons(*runs[1:])[0]


def test_runs_are_called_by_the_ends_of_their_paths_that_differ(tmp_path):
    paths = ["fox/3dgs/1", "fox/3dgs/2", "plush/3dgs/1"]
    records = [record(tmp_path / path, {"a": 20.0}) for path in paths]
    assert labels(records[:2]) == ["1", "2"]
    assert labels(records) == paths
    assert len(set(labels([records[0], records[0]]))) == 2


def test_runs_of_other_scenes_and_methods_are_called_by_these(tmp_path):
    records = [record(tmp_path / place, {"a": 20.0}) for place in ("first", "second", "third")]
    for run, method in zip(records, ("3dgs", "4dgs", "3dgs"), strict=True):
        run.settings["method"] = method
    assert labels(records) == ["3dgs/first", "4dgs/second", "3dgs/third"]
    records[2].summary["scene"] = "fox"
    assert labels(records) == ["made/3dgs/first", "made/4dgs/second", "fox/3dgs/third"]


def test_the_size_of_compared_images_is_a_row(tmp_path):
    small = {**PROTOCOL, "downscale": 2}
    runs = [record(tmp_path / "one", {"a": 20.0}),
            record(tmp_path / "two", {"a": 25.0}, protocol=small)]  # fmt: skip
    out = write_comparison([(run, Opened(None)) for run in runs], RULE, tmp_path / "c.html")
    sizes = "<td>32 x 24 pixels</td><td>32 x 24 pixels (1/2 of their size)</td>"
    assert f"<tr><td>images</td>{sizes}</tr>" in out.read_text()


def test_settings_that_differ_are_listed_and_names_escaped(tmp_path):
    one = write_run(tmp_path / "<b>one", {"<i>": 20.0}, steps=10)
    two = write_run(tmp_path / "two", {"<i>": 22.0}, steps=20)
    runs = [(read_run(folder), Opened(None)) for folder in (one, two)]
    page = parsed(write_comparison(runs, RULE, tmp_path / "c.html"))
    assert "steps 10 20" in page.text
    assert "<b>one" in page.text
    assert not page.all("b")
    assert not page.all("i")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["a", "b", "c", "d", "e", "f", "g"], "7 runs: a report compares at most 6."),
        (["a", "views=0"], "views=0: expected a number from 1 to 18."),
    ],
)
def test_more_than_a_page_can_hold_is_refused(tmp_path, arguments, message, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in "abcdefg":
        write_run(tmp_path / name, {"a": 20.0})
    assert main(["report", *arguments]) == 2
    assert message in capsys.readouterr().err


def planned(folder, pace, steps, rate):
    """A run that was planned, as its config.yaml says it."""
    made = write_run(folder, {"a": 20.0}, steps=steps)
    text = made.config.read_text().replace("given: [method, steps]", "given: [method, steps, pace]")
    lists = "planned: [steps, pace, optim.sh_rest_lr]\n"
    made.config.write_text(f"{lists}{text}pace: {pace}\noptim.sh_rest_lr: {rate}\n")
    return read_run(made)


def test_what_a_plan_decided_was_chosen_by_nobody_and_pace_is_no_difference(tmp_path):
    one = planned(tmp_path / "one", "['9:1.500']", 100, 5e-4)
    two = planned(tmp_path / "two", "['7:1.250']", 200, 1e-3)
    assert one.given == {"method"}
    assert one.planned == {"steps", "pace", "optim.sh_rest_lr"}
    compared = RunComparison((one, two))
    assert compared.chosen == ["steps"], "of the choices that are always shown"
    assert compared.following == ["optim.sh_rest_lr"]
    text = str(settings_section(one))
    assert "3 settings planned for the given time" in text
