"""Tests of gsfw.studies.study_file: every mistake is told with its place."""

import pytest

from gsfw.core.errors import ConfigError
from gsfw.studies.study import COLUMNS, Rule
from gsfw.studies.study_file import read_study

WHOLE = """
title: Things that move
about: >
  Two methods,
  one scene.
settings: {steps: 10, optim: {sparse: true}}
seeds: [1, 2]
rows:
  3dgs: {method: 3dgs, ignore_time: true}
  4dgs: {method: 4dgs, means_lr: 1e-4}
scenes:
  robot: {data: dynamic/robot}
rules:
  - {rows: 3dgs, seeds: 7}
  - {rows: [4d*], scenes: robot, skip: no time}
columns: [psnr, ssim]
"""


def test_a_file_is_a_study(tmp_path):
    path = tmp_path / "what moves.yaml"
    path.write_text(WHOLE)
    study = read_study(path)
    assert (study.name, study.title) == ("what-moves", "Things that move")
    assert study.about == "Two methods, one scene."
    assert study.settings == {"steps": 10, "optim.sparse": True}
    assert study.rows == {
        "3dgs": {"method": "3dgs", "ignore_time": True},
        "4dgs": {"method": "4dgs", "means_lr": "1e-4"},
    }
    assert study.scenes == {"robot": {"data": "dynamic/robot"}}
    assert study.seeds == (1, 2)
    assert study.rules == (
        Rule(("3dgs",), ("*",), seeds=(7,)),
        Rule(("4d*",), ("robot",), skip="no time"),
    )
    assert study.columns == ("psnr", "ssim")


def test_rows_and_scenes_are_all_that_it_needs(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text("rows: {3dgs: {method: 3dgs}}\nscenes: {built-in: {}}\n")
    study = read_study(path)
    assert (study.title, study.seeds, study.columns) == ("small", (42,), COLUMNS)
    assert [cell.settings for cell in study.cells()] == [{"method": "3dgs", "seed": 42}]


LEAST = "rows: {a: {}}\nscenes: {b: {}}\n"

MISTAKES = {
    "rows: {a: {}}\nscenes: [b\n": (
        "study FILE, line 3, column 1: this is not valid YAML: expected ',' or ']', but got "
        "'<stream end>'.\nIndent with spaces, and quote texts that hold ': ' or begin with a "
        "special character."
    ),
    "": (
        "study FILE: expected 'key: value' on each line, found nothing.\n"
        "Keys: title, about, settings, seeds, rows, scenes, rules, columns."
    ),
    f"{LEAST}row: {{}}": (
        "study FILE: unknown key 'row'. Did you mean 'rows'?\n"
        "Keys: title, about, settings, seeds, rows, scenes, rules, columns."
    ),
    "scenes: {b: {}}": (
        "study FILE: rows: expected a name and its settings for each, found nothing.\n"
        "Such as rows:\n  first: {steps: 1000}"
    ),
    "rows: {a: 3}\nscenes: {b: {}}": "study FILE: rows: a: expected settings, found 3.",
    "rows: {a: {steps: }}\nscenes: {b: {}}": (
        "study FILE: rows: a: steps has no value.\nWrite key: value."
    ),
    "rows: {a: {out: here}}\nscenes: {b: {}}": (
        "study FILE: rows: a: out cannot be set here.\nThe study chooses the folders."
    ),
    f"{LEAST}settings: {{seed: 3}}": (
        "study FILE: settings: seed cannot be set here.\nWrite it under seeds:."
    ),
    "rows: {a b: {}, A-b: {}}\nscenes: {b: {}}": (
        "study FILE: rows: 'a b' and 'A-b' would have the same folder.\n"
        "Let them differ in more than case, spaces and special characters."
    ),
    f"{LEAST}seeds: [1, 1]": (
        "study FILE: seeds: expected different whole numbers, found [1, 1].\n"
        "Such as seeds: [1, 2, 3]."
    ),
    f"{LEAST}columns: psnr": "study FILE: columns: expected names, found 'psnr'.",
    f"{LEAST}title: [x]": "study FILE: title: expected text, found a list.",
    f"{LEAST}rules: [{{rows: a, seed: 3}}]": (
        "study FILE, rule 1: unknown key 'seed'. Did you mean 'seeds'?\n"
        "Keys: rows, scenes, seeds, settings, skip."
    ),
    f"{LEAST}rules: [{{rows: a}}]": (
        "study FILE, rule 1: it changes nothing.\nGive it seeds, settings or skip."
    ),
    f"{LEAST}rules: [{{rows: c, skip: x}}]": (
        "study FILE, rule 1: rows: 'c' names none.\nThere are a."
    ),
    f"{LEAST}rules: 3": "study FILE: rules: expected a list of rules, found 3.",
}


@pytest.mark.parametrize("text", MISTAKES)
def test_a_mistake_is_told_with_its_place(text, tmp_path):
    path = tmp_path / "file.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_study(path)
    assert str(caught.value).replace(str(path), "FILE") == MISTAKES[text]


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(ConfigError, match=r"x.yaml: there is no such study file\."):
        read_study(tmp_path / "x.yaml")
    with pytest.raises(ConfigError, match="the study file cannot be read: "):
        read_study(tmp_path)


@pytest.mark.parametrize(
    ("text", "place", "key"),
    [
        ("rows:\n  a: {steps: 1}\n  a: {steps: 2}\n", "line 3, column 3", "a"),
        ("scenes: {balls: {steps: 1, steps: 2}}\n", "line 1, column 28", "steps"),
    ],
)
def test_a_key_that_is_there_twice_is_refused(tmp_path, text, place, key):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_study(path)
    expected = f"study {path}, {place}: this is not valid YAML: {key!r} is there twice."
    assert caught.value.message == expected
