"""Tests of gsfw.studies.study."""

import pytest
from support.small_study import TINY, small_study

from gsfw.core.errors import ConfigError
from gsfw.studies.study import Rule, slug

SCENES = {"balls": {}, "boxes": {"downscale": 2}}


def names(study, only=()) -> list[str]:
    return [cell.name for cell in study.cells(only)]


def test_every_row_is_made_on_every_scene_with_every_seed():
    assert names(small_study(scenes=SCENES, seeds=(1, 2)))[:3] == [
        "still on balls, seed 1",
        "still on balls, seed 2",
        "moves on balls, seed 1",
    ]
    assert len(names(small_study(scenes=SCENES, seeds=(1, 2)))) == 8


def test_rules_win_over_rows_and_these_over_scenes_and_those_over_the_rest():
    study = small_study(
        rows={"a": {}, "b": {"steps": 30}},
        scenes={"balls": {}, "boxes": {"steps": 20}},
        rules=(Rule(("b",), ("boxes",), settings={"steps": 40}),),
    )
    steps = {(cell.row, cell.scene): cell.settings["steps"] for cell in study.cells()}
    assert steps == {
        ("a", "balls"): TINY["steps"],
        ("b", "balls"): 30,
        ("a", "boxes"): 20,
        ("b", "boxes"): 40,
    }


def test_rules_give_seeds_and_leave_cells_out():
    rules = (
        Rule(("m*",), ("*",), seeds=(1, 2)),
        Rule(("still",), ("boxes",), skip="it has no use"),
    )
    study = small_study(scenes=SCENES, rules=rules)
    assert [cell.key for cell in study.cells()] == [
        ("balls", "still", 1),
        ("balls", "moves", 1),
        ("balls", "moves", 2),
        ("boxes", "moves", 1),
        ("boxes", "moves", 2),
    ]
    assert study.skipped("still", "boxes") == "it has no use"


def test_only_limits_rows_by_rows_and_scenes_by_scenes():
    study = small_study(scenes=SCENES)
    assert names(study, ["st*"]) == ["still on balls, seed 1", "still on boxes, seed 1"]
    assert names(study, ["boxes"]) == ["still on boxes, seed 1", "moves on boxes, seed 1"]
    assert names(study, ["boxes", "moves"]) == ["moves on boxes, seed 1"]
    with pytest.raises(ConfigError) as caught:
        study.cells(["boxs"])
    assert str(caught.value) == (
        "only=boxs: 'A small study' has no such row or scene. Did you mean 'boxes'?\n"
        "Rows: still, moves. Scenes: balls, boxes."
    )


def test_a_name_with_brackets_is_itself_and_not_only_a_pattern():
    study = small_study(rows={"3dgs [short]": {}, "4dgs": {}})
    assert [cell.row for cell in study.cells(["3dgs [short]"])] == ["3dgs [short]"]


def test_names_become_parts_of_paths():
    assert slug("4dgs, static=auto") == "4dgs-static-auto"
    assert slug("4d-rotor") == "4d-rotor"
    assert slug("..") == "run"
