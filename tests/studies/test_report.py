"""Tests of gsfw.studies.report, and of the files that are made of results."""

import csv
import io
from dataclasses import replace

from PIL import Image
from support.small_study import TINY, small_study

from gsfw.studies.comparison import find_column
from gsfw.studies.report import csv_text, protocol_lines, write_report
from gsfw.studies.result import Failure, Result, ResultStore
from gsfw.studies.study import Rule

PROTOCOL = {
    "checkpoint": "last",
    "psnr": "per image",
    "ssim": "11x11",
    "downscale_filter": "area",
    "image_sizes": [[32, 24]],
    "views": 2,
}
ORIGIN = {"gsfw": "1.0", "commit": "abc", "torch": "2", "cpu": "a cpu", "cores": 2, "threads": 1}


def result(row: str, seed: int, **figures: float) -> Result:
    settings = {"steps": 10, "downscale": 2.0, "rasterizer": "cpu"}
    given = {**TINY, **small_study().rows[row], "seed": seed}
    return Result(
        row, "balls", seed, f"{row}{seed}", given, settings, figures, PROTOCOL, ORIGIN, "2026-01-02"
    )


STUDY = small_study(
    about="Two of them.",
    columns=("psnr", "num_gaussians"),
    rules=(Rule(("moves",), ("*",), seeds=(1, 2)),),
)
RESULTS = [
    result("still", 1, psnr=20.0, num_gaussians=1000),
    result("moves", 1, psnr=25.0, num_gaussians=2000, extra=1.5),
    result("moves", 2, psnr=26.0, num_gaussians=2000),
]

REPORT = """\
# A small study

Two of them.

- steps 10; downscale 2 (area filter); seeds 1, 2
- rows: still (`method=3dgs ignore_time=true`); moves (`method=4dgs`)
- held-out views, last checkpoint; PSNR per image; SSIM 11x11
- held out: balls 2 images of 32x24
- machine: a cpu, 2 cores, threads per run 1; rasterizer cpu; torch 2
- gsfw 1.0, commit abc; made 2026-01-02
- command: `gsfw study small.yaml`

The best is bold. ± is the standard deviation over seeds; ≈ is a tie with the best: the two \
differ by no more than the sum of their spreads (a row with one seed has the largest spread of the \
scene).

## balls

|  | PSNR (dB) | Gaussians |
| --- | ---: | ---: |
| still | 20.00 | 1,000 |
| moves | **25.50 ± 0.71** | 2,000 |

![A small study](study.png)
"""


def written(tmp_path, *results: Result) -> str:
    store = ResultStore(tmp_path / "results.json", STUDY.title)
    for item in results:
        store.keep(item)
    write_report(STUDY, store, tmp_path, "gsfw study small.yaml")
    return (tmp_path / "study.md").read_text(encoding="utf-8")


def test_the_report_has_the_protocol_and_a_table_per_scene(tmp_path):
    assert written(tmp_path, *RESULTS) == REPORT


def test_the_report_says_what_is_missing(tmp_path):
    text = written(tmp_path, *RESULTS[:2])
    assert "- moves: not trained yet: seed 2\n" in text
    assert "standard deviation" not in text


def test_a_bar_in_a_name_does_not_end_its_cell(tmp_path):
    study = small_study(rows={"still | short": {"method": "3dgs"}}, columns=("psnr",))
    store = ResultStore(tmp_path / "results.json", study.title)
    store.keep(replace(result("still", 1, psnr=20.0), row="still | short"))
    write_report(study, store, tmp_path, "gsfw study")
    assert "| still \\| short | 20.00 |\n" in (tmp_path / "study.md").read_text()


def test_nothing_is_written_without_results(tmp_path):
    store = ResultStore(tmp_path / "results.json", STUDY.title)
    assert write_report(STUDY, store, tmp_path, "") == []
    assert list(tmp_path.iterdir()) == []


def test_the_plot_is_an_image(tmp_path):
    written(tmp_path, *RESULTS)
    with Image.open(tmp_path / "study.png") as image:
        colors = {color for _, color in image.convert("RGB").getcolors(1 << 22)}
    assert {(31, 91, 171), (209, 98, 36)} <= colors, "a dot for each row"


def test_the_csv_has_a_line_per_run_and_every_figure():
    rows = list(csv.DictReader(io.StringIO(csv_text(STUDY, RESULTS))))
    assert [row["row"] for row in rows] == ["still", "moves", "moves"]
    assert list(rows[0])[:5] == ["scene", "row", "seed", "psnr", "num_gaussians"]
    assert (rows[0]["extra"], rows[1]["extra"]) == ("", "1.5")
    assert (rows[1]["settings"], rows[1]["commit"]) == ("moves1", "abc")


def test_what_differs_between_runs_is_listed_in_the_protocol():
    longer = Result("still", "balls", 3, "0", {}, {"steps": 20}, {})
    assert protocol_lines(STUDY, [*RESULTS, longer], "")[0].startswith("steps 10, 20; downscale 2")


def test_figures_are_written_as_their_column_says():
    assert find_column("num_gaussians").text(12345.0) == "12,345"
    assert find_column("flicker_static").text(0.00123) == "0.00123"
    assert find_column("static_rows").heading == "static rows"
    assert find_column("static_rows").text(0.71234) == "0.712"
    assert find_column("lpips").better(0.1, than=0.2)


def test_failures_are_reported_with_their_reasons(tmp_path):
    study = small_study(scenes={"balls": {}, "boxes": {}}, columns=("psnr",))
    store = ResultStore(tmp_path / "results.json", study.title)
    store.keep(Failure("still", "boxes", 1, "no."))
    write_report(study, store, tmp_path, "gsfw study")
    failed = "## boxes\n\n- still: seed 1 failed: no.\n- moves: not trained yet: seed 1\n"
    assert (tmp_path / "study.md").read_text() == f"# A small study\n\n{failed}"
    store.keep(result("still", 1, psnr=20.0))
    write_report(study, store, tmp_path, "gsfw study")
    text = (tmp_path / "study.md").read_text()
    assert "## balls\n\n|  | PSNR (dB) |\n" in text
    assert failed in text
