"""What the user asks for: a time, a quality, and what contradicts them."""

import pytest
from support.small_scene import SMALL_SCENE

from gsfw.core.errors import ConfigError
from gsfw.planning.asked import BOUND, Asked, asked_of, spelled_out
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve

SCENE = {**dict(item.split("=") for item in SMALL_SCENE), "method": "3dgs", "device": "cpu"}


def asked(*layers: dict) -> Asked | None:
    """What these values ask for: those of files, and at last those of the command line."""
    sources = [f"config file {place}" for place in range(len(layers) - 1)] + [COMMAND_LINE]
    given = spelled_out([Layer(COMMAND_LINE, SCENE), *map(Layer, sources, layers)])
    return asked_of(resolve(installed(), given), given)


def refusal(*layers: dict) -> str:
    with pytest.raises(ConfigError) as caught:
        asked(*layers)
    return str(caught.value)


def test_a_run_of_steps_asks_for_nothing():
    assert asked({}) is None
    assert asked({"steps": "300"}) is None


def test_a_time_and_a_quality_are_asked_for():
    assert asked({"minutes": "5"}) == Asked(5.0)
    assert asked({"until": "31", "minutes": "0.5"}) == Asked(0.5, "31")
    assert str(Asked(0.5, "31")) == "minutes=0.5 until=31"


def test_a_quality_that_is_never_reached_has_a_bound_in_time():
    assert asked({"until": "99"}) == Asked(BOUND, "99")


def test_steps_auto_is_until_auto():
    assert asked({"steps": "auto"}) == Asked(BOUND, "auto")
    assert "Give one of them" in refusal({"steps": "auto", "until": "30"})


def test_a_time_of_nothing_is_refused_with_what_to_give():
    said = refusal({"minutes": "0"})
    assert "minutes=0: expected more than 0 minutes." in said
    assert "minutes=5" in said
    assert "minutes=-1" in refusal({"minutes": "-1"})
    assert "expected a number" in refusal({"minutes": "soon"})


def test_a_time_and_a_number_of_steps_contradict_each_other():
    said = refusal({"minutes": "2", "steps": "300"})
    assert "minutes=2 and steps=300: a run ends after a time or after a number of steps." in said
    assert "Leave out steps=300" in said


@pytest.mark.parametrize("until", ["much", "-3", "nan", "inf", "0"])
def test_a_quality_that_is_no_psnr_is_refused(until):
    assert f"until={until}: expected a PSNR in dB such as 31, or auto." in refusal({"until": until})


def test_schedules_that_may_not_follow_cannot_be_planned():
    assert "rescale=false keeps every schedule" in refusal({"minutes": "2", "rescale": "false"})


def test_a_recorded_plan_repeats_unless_a_time_is_given_after_it():
    recorded = {"steps": "400", "pace": ["20:1.500"], "eval_every": "200"}
    assert asked(recorded, {}) is None
    assert asked(recorded, {"minutes": "2"}) == Asked(2.0)
    given = spelled_out([Layer("a file", recorded), Layer(COMMAND_LINE, {"minutes": "2"})])
    assert given[0].values == {}, "its decisions are not kept"


def test_a_recorded_plan_leaves_nothing_to_another_one_but_what_the_user_gave():
    values = {"steps": "400", "pace": [], "downscale": "3", "optim.sh_rest_lr": "5e-4", "seed": "4"}
    planned = frozenset({"steps", "pace", "downscale", "optim.sh_rest_lr"})
    recorded = Layer("a file", values, planned=planned)
    given = spelled_out([recorded, Layer(COMMAND_LINE, {"minutes": "2"})])
    assert given[0].values == {"seed": "4"}
    assert given[0].planned == frozenset()
    repeated = spelled_out([recorded, Layer(COMMAND_LINE, {"seed": "5"})])
    assert repeated[0].values == values, "the same run, with another seed"


def test_steps_given_after_a_time_replace_it():
    assert asked({"minutes": "2"}, {"steps": "300"}) is None
