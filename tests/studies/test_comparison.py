"""Tests of gsfw.studies.comparison."""

from support.small_study import TINY, small_study

from gsfw.studies.comparison import compare
from gsfw.studies.result import Failure, Result
from gsfw.studies.study import Rule

ROWS = {"a": {}, "b": {}, "c": {}}


def result(row: str, seed: int = 1, scene: str = "balls", **figures: float) -> Result:
    given = {**TINY, "seed": seed}
    return Result(row, scene, seed, "0", given, {}, figures)


def table(*results: Result, failures: tuple[Failure, ...] = (), **changed):
    study = small_study(rows=ROWS, columns=("psnr", "num_gaussians", "ssim"), **changed)
    (found,) = compare(study, {r.key: r for r in results}, {f.key: f for f in failures})
    return found


def marks(found, column: str) -> dict[str, str]:
    return {
        line.row: "best" if figure.is_best else "tie" if figure.is_tie else "worse"
        for line in found.lines
        if (figure := line.figures.get(column))
    }


def test_a_row_has_the_mean_and_the_standard_deviation_over_its_seeds():
    found = table(*(result("a", seed, psnr=19.0 + seed) for seed in (1, 2, 3)), seeds=(1, 2, 3))
    figure = found.lines[0].figures["psnr"]
    assert (figure.mean, figure.spread, figure.seeds) == (21.0, 1.0, 3)


def test_without_seeds_there_is_no_spread_and_no_tie():
    found = table(result("a", psnr=20.0), result("b", psnr=20.001), result("c", psnr=19.0))
    assert found.lines[0].figures["psnr"].spread is None
    assert marks(found, "psnr") == {"a": "worse", "b": "best", "c": "worse"}


def test_what_differs_by_less_than_both_spreads_is_a_tie():
    found = table(
        *(result("a", seed, psnr=20.0 + seed * 0.1) for seed in (1, 2)),  # 20.15 +- 0.07
        result("b", psnr=20.28),  # Given the same spread.
        result("c", psnr=20.0),
        rules=(Rule(("a",), ("*",), seeds=(1, 2)),),
    )
    assert marks(found, "psnr") == {"a": "tie", "b": "best", "c": "worse"}


def test_equal_rows_are_all_the_best():
    found = table(result("a", psnr=20.0), result("b", psnr=20.0), result("c", psnr=19.0))
    assert marks(found, "psnr") == {"a": "best", "b": "best", "c": "worse"}


def test_costs_are_not_judged_nor_is_a_row_without_rivals():
    found = table(result("a", num_gaussians=10, ssim=0.5), result("b", num_gaussians=20))
    assert marks(found, "num_gaussians") == {"a": "worse", "b": "worse"}
    assert marks(found, "ssim") == {"a": "worse"}


def test_columns_that_nothing_has_are_left_out():
    found = table(result("a", psnr=20.0))
    assert [column.name for column in found.columns] == ["psnr"]


def test_a_line_says_what_is_missing():
    failed = Failure("a", "balls", 2, "no.")
    rules = (Rule(("c",), ("*",), skip="it needs time"),)
    found = table(result("a", psnr=20.0), failures=(failed,), seeds=(1, 2, 3), rules=rules)
    assert [line.note for line in found.lines] == [
        "seed 2 failed: no.; not trained yet: seed 3",
        "not trained yet: seeds 1, 2, 3",
        "it needs time",
    ]


def test_a_line_says_that_its_settings_have_changed_since():
    now = {**TINY, "log_every": 5}
    assert table(result("a", psnr=20.0), settings=now).lines[0].note == "", "which matters not"
    now = {**TINY, "steps": 11}
    note = table(result("a", psnr=20.0), settings=now).lines[0].note
    assert note == "trained before the settings changed: seed 1"


def test_scenes_without_results_are_left_out():
    study = small_study(scenes={"balls": {}, "boxes": {}}, rows=ROWS)
    found = compare(study, {r.key: r for r in [result("a", psnr=1.0)]}, {})
    assert [table.scene for table in found] == ["balls"]


def test_a_scene_on_which_every_run_failed_says_why():
    study = small_study(scenes={"balls": {}, "boxes": {}}, rows={"a": {}})
    failed = Failure("a", "boxes", 1, "no.")
    (found,) = compare(study, {}, {failed.key: failed})
    assert (found.scene, found.columns) == ("boxes", ())
    assert [line.note for line in found.lines] == ["seed 1 failed: no."]
