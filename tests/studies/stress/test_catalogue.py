"""The catalogue as a list: what it holds, how cases are chosen, and that each is made anew."""

import re

import pytest
import torch

from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import installed
from gsfw.studies.entrants import entrant_of
from gsfw.studies.stress.case import Section
from gsfw.studies.stress.catalogue import CASES, chosen
from gsfw.studies.stress.measure import Oracle, measure
from gsfw.studies.stress.moving_case import MOVING_CASES, dynamic_methods, moving_model
from gsfw.studies.stress.moving_measure import measure_moving
from gsfw.studies.stress.runner import NAMES, StressPlan, run

# Whole trainings and scenes; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked

NAME = re.compile(r"[a-z]+(/[a-z0-9.-]+)+")


def test_every_section_has_cases_and_names_are_words_that_can_be_typed():
    assert {case.section for case in CASES.values()} | {Section.TIME} == set(Section)
    assert len(set(NAMES)) == len(NAMES)
    assert all(NAME.fullmatch(name) for name in NAMES)


@pytest.mark.slow
def test_cases_are_the_same_at_every_call():
    for case in CASES.values():
        if case.section is not Section.SIZE:
            first, second = case.make().splats.tensors(), case.make().splats.tensors()
            for name, tensor in first.items():
                assert tensor is not second[name]
                if not tensor.is_meta:
                    torch.testing.assert_close(tensor, second[name], rtol=0, atol=0, equal_nan=True)


def test_cases_are_chosen_by_name_section_or_pattern():
    names = ["shape/needles", "shape/needles/fisheye", "depth/equal", "depth/equal/fisheye"]
    assert chosen(names, ()) == names
    assert chosen(names, ("depth",)) == names[2:]
    assert chosen(names, ("*/fisheye",)) == [names[1], names[3]]
    assert chosen(names, ("depth/equal", "shape/needles/fisheye")) == names[1:]
    with pytest.raises(ConfigError) as caught:
        chosen(names, ("depth", "shape/needle"))
    assert str(caught.value) == (
        "only=shape/needle: no case has this name. Did you mean 'shape/needles'?\n"
        "List them with gsfw stress list=true."
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", dynamic_methods(installed()))
def test_dynamic_methods_pass_the_cases_of_time(method):
    model = moving_model(method, installed())
    claimed = 0
    for case in MOVING_CASES:
        result = measure_moving(case, method, model, torch.float32)
        assert not result.faults, case.name
        claimed += result.passed
    assert claimed >= 2
    assert measure_moving(MOVING_CASES[0], method, model, torch.float64).passed


def test_what_a_method_lacks_is_not_claimed_rather_than_passed():
    model = moving_model("dynamic3dgs", installed())
    case = next(case for case in MOVING_CASES if case.name == "time/polynomials")
    result = measure_moving(case, "dynamic3dgs", model, torch.float32)
    assert not result.passed
    assert not result.faults
    assert result.not_claimed == "needs columns motion"


def test_a_model_that_fails_is_a_result():
    model = moving_model("spacetime", installed())
    model.splats = None  # type: ignore[assignment]
    result = measure_moving(MOVING_CASES[0], "spacetime", model, torch.float32)
    assert result.faults == ("fails with TypeError: 'NoneType' object is not callable",)


@pytest.mark.slow
def test_a_plan_knows_how_many_results_there_will_be():
    cpu = entrant_of("reference", installed())
    only = ("depth/equal", "input/skew", "time/outside", "size/more-pairs-than-memory")
    plan = StressPlan([cpu], ["spacetime"], ("float32", "float64"), only)
    assert len(list(run(plan, installed()))) == len(plan) == 6 * 2 + 1 + 2 + 1


def test_a_backend_is_repeated_with_one_thread_and_with_two():
    backend = entrant_of("reference", installed())
    assert backend.threads == (1, 2)
    before = torch.get_num_threads()
    case = CASES["shape/needles"]
    result = measure(backend, case, torch.float32, Oracle(backend.rasterizer))
    assert result.deterministic is True
    assert torch.get_num_threads() == before
