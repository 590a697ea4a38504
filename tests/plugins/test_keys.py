"""Tests of gsfw.plugins.keys."""

from dataclasses import dataclass, make_dataclass

from support.fake_parts import Demo, Grow, Move

from gsfw.plugins.keys import class_help, field_help, keys, suggest_key


@dataclass
class Silent:
    number: int = 3
    other: int = 4

    """Too far away to be about other."""


def test_keys_are_dotted_and_leave_out_the_choices_themselves():
    names = [key.name for key in keys(Demo(strategy=Grow()))]
    assert "strategy.every" in names
    assert "optim.sparse" in names
    assert "strategy" not in names
    assert "sampler" not in names


def test_nested_keys_follow_the_plain_ones():
    names = [key.name for key in keys(Demo())]
    assert names.index("mode") < names.index("optim.sparse")


def test_the_help_of_a_key_is_the_sentence_under_its_field_inherited_or_not():
    explained = {key.name: key.help for key in keys(Demo(strategy=Move()))}
    assert explained["strategy.cap"] == "Most splats there may be."
    assert explained["strategy.every"] == "Steps between growing."
    assert explained["seed"].startswith("Seed of every generator;")


def test_a_field_without_a_docstring_has_no_help():
    assert field_help(Silent).get("number") is None


def test_a_class_without_source_has_no_help():
    assert field_help(make_dataclass("Made", [("number", int, 3)])) == {}


def test_the_help_of_a_class_is_its_docstring_also_where_python_has_none():
    @dataclass
    class Documented:
        """A first line.

        A second one.
        """

    Documented.__doc__ = "Documented()"  # As with python -OO.
    assert class_help(Documented) == "A first line.\n\nA second one."
    assert class_help(Silent) == ""


def test_suggestions_take_the_last_part_first_and_stay_silent_when_far_off():
    known = ["seed", "optim.means_lr", "optim.sparse"]
    assert suggest_key("optim.mean_lr", known) == " Did you mean 'optim.means_lr'?"
    assert suggest_key("means_lr", known) == " Did you mean 'optim.means_lr'?"
    assert suggest_key("zzz", known) == ""


def test_words_of_other_tools_suggest_ours_if_the_chosen_parts_have_them():
    known = ["steps", "validation", "downscale", "resolution_steps", "holdout_every", "seed"]
    assert suggest_key("iterations", known) == " Did you mean 'steps'?"
    assert suggest_key("pipeline.max_num_iterations", known) == " Did you mean 'steps'?"
    assert suggest_key("resolution", known) == " Did you mean 'downscale'?"
    assert suggest_key("eval", known) == " Did you mean 'holdout_every'?"
    assert suggest_key("lr", known) == ""
    assert suggest_key("lr", [*known, "optim.means_lr"]) == " Did you mean 'optim.means_lr'?"
    assert suggest_key("max_gs_num", known) == "", "the strategy has no such setting"
