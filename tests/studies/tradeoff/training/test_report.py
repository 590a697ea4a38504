"""Tables call what seeds alone could do a tie, and recommendations are commands that reach it."""

import csv
import io
import shlex
from dataclasses import replace

import pytest

from gsfw.studies.table import table_of_records
from gsfw.studies.tradeoff.files import write_training_files
from gsfw.studies.tradeoff.recommendation import Wish
from gsfw.studies.tradeoff.recommendation import recommend as recommend_of
from gsfw.studies.tradeoff.training.report import (
    documents,
    in_order,
    offers,
    spread_text,
    table,
    usual_wish,
)
from gsfw.studies.tradeoff.training.trained import Trained, spread, unbeaten


def trained(variant, steps, psnr, file_mb, seconds=10.0, ms=5.0, again=None, axes=("cap",)):
    return Trained(
        variant=variant,
        steps=steps,
        words=("method=3dgs", "data=my data", f"steps={steps}"),
        changed={} if variant == "baseline" else {"sh_degree": 1},
        psnr=psnr,
        ssim=0.9,
        file_mb=file_mb,
        model_bytes=int(file_mb * 1e6),
        num_gaussians=1000,
        train_seconds=seconds,
        draw_ms=ms,
        draw_spread_ms=0.5,
        flip=0.05 if variant == "baseline" else None,
        peak_memory_mb=400.0,
        again=again,
        axes=() if variant == "baseline" else axes,
    )


def recommend(found, wish):
    return recommend_of(offers(found), wish, usual_wish(found))


SMALL = trained("cap 1/2", 200, 29.0, 4.0)
FOUND = [
    trained("cap 1/2", 100, 27.0, 4.0, 5.0, again=27.1),
    trained("baseline", 200, 30.0, 8.0, 20.0),
    trained("baseline", 100, 28.0, 8.0, 10.0, again=27.98),
    SMALL,
    trained("sh 1", 200, 29.95, 6.0, 19.0, axes=("sh_degree",)),
]


def test_the_baseline_comes_first_and_long_runs_ahead():
    assert [item.name for item in in_order(FOUND)] == [
        *("baseline, 200 steps", "baseline, 100 steps"),
        *("cap 1/2, 200 steps", "cap 1/2, 100 steps", "sh 1, 200 steps"),
    ]


def test_the_spread_is_that_of_pairs_of_seeds():
    # The standard deviation of two is their difference over the square root of 2.
    assert abs(spread(FOUND) - ((0.1**2 + 0.02**2) / 2 / 2) ** 0.5) < 1e-12
    assert spread([SMALL]) is None
    assert "(2 of the variants with two)" in spread_text(FOUND)
    assert "differences up to 0.10 dB are ties" in spread_text(FOUND)
    assert "is not known" in spread_text([SMALL])


def test_what_seeds_alone_could_do_is_a_tie():
    by_name = {row["name"]: row for row in documents(FOUND) if row["steps"] == 200}
    assert by_name["sh 1"]["is_tie"]
    assert not by_name["cap 1/2"]["is_tie"]
    assert "sh 1, 200 steps" in [point.name for point in unbeaten(FOUND, "MB")]
    assert "baseline, 200 steps" not in [point.name for point in unbeaten(FOUND, "MB")]


def test_training_times_that_differ_by_no_more_than_between_seeds_are_a_tie():
    fast, slow = trained("a", 100, 28.0, 4.0, 10.0), trained("b", 100, 28.0, 4.0, 10.5)
    assert [point.name for point in unbeaten([fast, slow], "training")] == ["a, 100 steps"]
    measured = replace(fast, again=28.0, seconds_again=11.0)
    assert len(unbeaten([measured, slow], "training")) == 2
    assert len(unbeaten([measured, replace(slow, train_seconds=20.0)], "training")) == 1


def test_every_figure_is_shown_and_the_csv_has_those_of_the_document():
    headings, rows, _ = table(FOUND)
    assert all(len(row) == len(headings) for row in rows)
    assert rows[0][:4] == ["baseline", "200", "30.00", ""]
    assert [row[5] for row in rows] == ["0.0500", "0.0500", "", "", ""]
    assert rows[2][:4] == ["cap 1/2", "200", "29.00", "1.00"]
    assert rows[4][3] == "tie"
    read = list(csv.DictReader(io.StringIO(table_of_records(documents(FOUND)).csv())))
    for row, document in zip(read, documents(FOUND), strict=True):
        assert (row["name"], row["psnr"]) == (document["name"], str(document["psnr"]))
        assert row["on_front"].split() == document["on_front"]
        assert row["flip"] == str(document["flip"] or "")
    assert documents(FOUND)[0]["floats"] == 2_000_000
    assert documents(FOUND)[0]["command"] == "train method=3dgs 'data=my data' steps=200"


def test_the_smallest_that_reaches_the_target_is_recommended():
    found = recommend(FOUND, Wish(psnr=28.5, megabytes=20.0))
    assert found.command == "gsfw train method=3dgs 'data=my data' steps=200"
    assert found.text == (
        f"For at least 28.50 dB and at most 20 MB: {found.command} "
        "(29.00 dB, 4.00 MB, 5.0 ms, 10 s of training)."
    )
    assert shlex.split(found.command)[2:] == list(SMALL.words)


def test_of_equal_files_the_one_trained_in_less_time_is_recommended():
    assert "5 s of training" in recommend(FOUND, Wish(psnr=26.5)).text


def test_a_budget_alone_takes_the_best_within_it():
    assert "29.95 dB" in recommend(FOUND, Wish(megabytes=7.0)).text


def test_nothing_asked_for_loses_no_more_than_seeds_do():
    assert recommend(FOUND, Wish()).text.startswith(
        "For a loss of at most 0.10 dB against the baseline: "
    )


def test_what_nothing_reaches_is_told_with_what_comes_nearest():
    found = recommend(FOUND, Wish(psnr=31.0, megabytes=5.0))
    assert found.command == ""
    assert found.text == (
        "at least 31.00 dB and at most 5 MB: no variant has it. cap 1/2, 200 steps comes nearest, "
        "2.00 dB short (29.00 dB, 4.00 MB, 5.0 ms, 10 s of training)."
    )
    assert recommend(FOUND, Wish(megabytes=1.0, ms=1.0)).text == (
        "at most 1 MB and at most 1 ms: no variant has it. There is 4.00 MB at least, 5.5 ms at "
        "least, spread included."
    )


@pytest.mark.slow
def test_the_files_are_written_and_the_plot_repeats(tmp_path):
    recommended = recommend(FOUND, Wish(psnr=28.5))
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_training_files(tmp_path / name, FOUND, recommended, {"downscale": 1.0})
    plots = [(tmp_path / name / "tradeoff.png").read_bytes() for name in ("a", "b")]
    assert plots[0] == plots[1]
    sessions = [path.parent.name for path in (tmp_path / "a" / "tb").glob("*/events*")]
    assert sorted(sessions) == sorted(item.name.replace("/", "-") for item in FOUND)
