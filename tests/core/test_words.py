"""Times, numbers of bytes and arguments in words; nothing else in the project spells them."""

import re
from pathlib import Path

import pytest

from gsfw.core.words import (
    brief,
    capitalized,
    clock,
    counted,
    duration,
    listed,
    metric_name,
    rough_duration,
    rough_size,
    shell_argument,
    shown_metrics,
    size,
    uncapitalized,
)

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ("number", "words"),
    [(12, "12 bytes"), (23_600, "24 kB"), (999_600, "1.0 MB"), (2.94e6, "2.9 MB"),
     (383.2e6, "383 MB"), (1.25e9, "1.2 GB")],
)  # fmt: skip
def test_sizes_have_two_or_three_digits(number, words):
    assert size(number) == words


def test_durations_have_their_two_largest_units():
    assert [duration(s) for s in (0.4, 59.6, 500, 7265.0, 11_100)] == [
        "0 s", "1 min 0 s", "8 min 20 s", "2 h 1 min", "3 h 5 min",
    ]  # fmt: skip


def test_estimates_have_one_unit():
    assert [rough_duration(s) for s in (0.1, 73, 89, 90, 725, 5400, 12_600)] == [
        "1 s", "73 s", "89 s", "2 min", "12 min", "1.5 h", "3.5 h",
    ]  # fmt: skip


def test_estimated_sizes_have_one_or_two_digits_of_gigabytes():
    assert [rough_size(n) for n in (0.2e6, 74.3e6, 999.6e6, 3.46e9, 9.96e9, 25_251e6)] == [
        "0 MB", "74 MB", "1.0 GB", "3.5 GB", "10 GB", "25 GB",
    ]  # fmt: skip


def test_a_clock_has_minutes_and_seconds_or_hours():
    assert [clock(s) for s in (0.2, 59.6, 3725.0)] == ["0:00", "1:00", "1:02:05"]


def test_an_argument_of_a_command_has_quotes_where_it_needs_them():
    typed = [shell_argument(path) for path in (Path("runs/a"), "my run", "it's")]
    assert typed == ["runs/a", "'my run'", "'it'\"'\"'s'"]


def test_no_other_module_spells_times_or_sizes_of_its_own():
    spells = re.compile(
        r"def _?(rough_)?(duration|clock|size_text|human_\w+)\(seconds|def size_text"
        r"|shlex\.quote\(|from shlex"
    )
    folders = (path.parent for path in ROOT.glob("*/__init__.py"))
    found = [
        str(path.relative_to(ROOT))
        for folder in folders
        for path in folder.rglob("*.py")
        if spells.search(path.read_text())
    ]
    assert found == ["core/words.py"]


def test_counts_have_a_singular_and_a_plural():
    assert [counted(count, "view") for count in (0, 1, 1200)] == [
        "0 views",
        "1 view",
        "1,200 views",
    ]
    assert [counted(count, "lens", "lenses") for count in (1, 2)] == ["1 lens", "2 lenses"]


def test_brief_numbers_have_a_letter_for_thousands_millions_and_billions():
    numbers = (0.05, 200.0, 20_000, 12_351, -2.5e6, 999_960, 2.5e9, 999_960_000)
    assert [brief(number) for number in numbers] == [
        "0.05", "200", "20k", "12.35k", "-2.5M", "1M", "2.5G", "1G",
    ]  # fmt: skip
    assert [brief(number, 3) for number in (950, 12_345, 999_600)] == ["950", "12.3k", "1M"]


def test_long_lists_of_names_end_in_their_number():
    names = ["a.png", "b.png", "c.png"]
    assert listed(names) == "a.png, b.png, c.png"
    assert listed(names, 1) == "a.png and 2 more"


def test_a_clause_becomes_a_sentence_and_a_sentence_a_clause():
    assert capitalized("the lens of an iPhone") == "The lens of an iPhone"
    assert uncapitalized("The lens of an iPhone") == "the lens of an iPhone"
    assert capitalized("") == uncapitalized("") == ""


def test_metrics_have_words():
    assert metric_name("moving_psnr") == "moving PSNR"
    assert metric_name("color_corrected_psnr") == "colour-corrected PSNR"


def test_corrected_colors_have_a_row_where_exposures_were_learnt():
    names = ["psnr", "color_corrected_psnr", "moving_color_corrected_psnr", "own"]
    assert shown_metrics(names, {"psnr": "per image"}) == ["psnr", "own"]
    assert shown_metrics(names, {"exposure": "learnt for training images"}) == names
