"""Tests of gsfw.plugins.other_tools: its names are real, and none of its words is ours."""

from gsfw.plugins.keys import SLOT_KEYS, keys
from gsfw.plugins.loading import load_all
from gsfw.plugins.other_tools import EQUIVALENTS, equivalent
from gsfw.plugins.registry import did_you_mean, installed


def own_names() -> set[str]:
    """Every setting of every built-in part, and the parts themselves."""
    names = {"method", "preset", *SLOT_KEYS}
    for slot in ("method", *SLOT_KEYS):
        prefix = "" if slot == "method" else f"{slot}."
        for name, kind in load_all(slot, installed()).items():
            names |= {name, *(key.name for key in keys(kind(), prefix))}
    return names


def test_every_suggested_name_is_a_setting_or_a_part():
    assert set(EQUIVALENTS.values()) - own_names() == set()


def test_no_setting_of_ours_counts_as_a_word_of_another_tool():
    assert set(EQUIVALENTS) & own_names() == set()


def test_no_setting_is_taken_for_a_misspelt_method():
    names = own_names() - {"method"}
    assert [name for name in names if did_you_mean(name, ["method"])] == []


def test_a_misspelt_word_of_another_tool_is_answered_with_ours():
    assert equivalent("iteration", ["steps", "validation"]) == "steps"
    assert equivalent("valdation", ["steps", "validation"]) == ""
