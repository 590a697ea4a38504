"""A recommended command meets what is asked for, and a verb really does it."""

from gsfw.studies.tradeoff.recommendation import Wish
from gsfw.studies.tradeoff.recommendation import recommend as recommend_of
from gsfw.studies.tradeoff.record import Record
from gsfw.studies.tradeoff.report import offers, usual_wish


def record(name, psnr, megabytes, ms=None, command=(), axis="sh", draws_alike=False):
    size = round(megabytes * 1e6)
    return Record(
        axis=axis,
        name=name,
        per_view=[{"psnr": psnr}] if psnr else [],
        relative_l2=0.0,
        max_error=0.0,
        num_gaussians=1,
        floats=size // 4,
        parameter_bytes=size,
        file_bytes=size if command and command[0] == "export" else None,
        command=list(command),
        readings=[ms] if ms else [],
        draws_alike=draws_alike,
    )


def recommend(records, wish, run, more=()):
    return recommend_of(offers(records, run, more), wish, usual_wish(records))


RECORDS = [
    record("as it is", 30.0, 10.0, 8.0, ["export"], axis="as it is"),
    record("degree 1", 29.95, 4.0, 7.0, ["export", "sh_degree=1"]),
    record("degree 0", 28.0, 2.0, 6.0, ["export", "sh_degree=0"]),
    record("fp16", 29.99, 1.0, None, axis="precision", draws_alike=True),
    record("1/2", 27.0, 10.0, 3.0, ["render", "scale=0.5"], axis="resolution"),
    record("broken", None, 0.1, None, ["export", "keep=0.1"], axis="prune"),
]


def test_nothing_asked_for_is_the_smallest_file_that_loses_little():
    found = recommend(RECORDS, Wish(), "runs/a b")
    assert found.command == "gsfw export 'runs/a b' sh_degree=1"
    assert found.text == (
        "For a loss of at most 0.1 dB: gsfw export 'runs/a b' sh_degree=1 (29.95 dB, 4.00 MB, "
        "7.0 ms)."
    )


def test_a_target_takes_the_smallest_file_and_a_budget_the_best_image():
    assert recommend(RECORDS, Wish(psnr=27.5), "r").command == "gsfw export r sh_degree=0"
    assert recommend(RECORDS, Wish(megabytes=5.0), "r").command == "gsfw export r sh_degree=1"
    assert recommend(RECORDS, Wish(ms=4.0), "r").command == "gsfw render r scale=0.5"
    both = recommend(RECORDS, Wish(psnr=29.97), "r", ["data=d"])
    assert both.command == "gsfw export r data=d"
    assert both.text.startswith("For at least 29.97 dB: ")


def test_what_no_verb_does_is_named_and_not_recommended():
    found = recommend(RECORDS, Wish(psnr=29.0, megabytes=1.5), "r")
    assert found.command == ""
    assert found.text == (
        "at least 29.00 dB and at most 1.5 MB: precision fp16 has it (29.99 dB, 1.00 MB, 8.0 ms), "
        "but no verb makes it yet."
    )


def test_where_nothing_has_it_the_reach_of_each_figure_is_told():
    found = recommend(RECORDS, Wish(psnr=35.0, megabytes=0.5, ms=1.0), "r")
    assert found.text == (
        "at least 35.00 dB and at most 0.5 MB and at most 1 ms: no variant has it. There is "
        "30.00 dB at most, 1.00 MB at least, 3.0 ms at least, spread included."
    )


def test_within_the_budgets_the_most_accurate_comes_nearest():
    found = recommend(RECORDS, Wish(psnr=35.0, megabytes=5.0), "r")
    assert found.text == (
        "at least 35.00 dB and at most 5 MB: no variant has it. precision fp16 comes nearest, "
        "5.01 dB short (29.99 dB, 1.00 MB, 8.0 ms)."
    )


def test_without_photos_the_model_as_it_is_is_the_measure():
    renders = [
        record("as it is", 100.0, 10.0, 8.0, ["export"], axis="as it is"),
        record("degree 2", 45.0, 6.0, 8.0, ["export", "sh_degree=2"]),
        record("degree 1", 35.0, 4.0, 8.0, ["export", "sh_degree=1"]),
    ]
    assert recommend(renders, Wish(), "m.gsfw").text == (
        "For at least 40 dB against the model as it is: gsfw export m.gsfw sh_degree=2 "
        "(45.00 dB, 6.00 MB, 8.0 ms)."
    )
