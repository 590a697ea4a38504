"""Tests of gsfw.core.returns: what parts return in a wrong form is named, with the remedy."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from support.mixed_model import MixedModel
from support.scenes import front_camera, random_splats

from gsfw.core.errors import ConfigError
from gsfw.core.learning_rate import LearningRate
from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.operators import Operators
from gsfw.core.parameter_group import ParameterGroup
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.refinement.refiners import checked_refiners
from gsfw.core.refiner import Refiner
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import RenderSettings
from gsfw.core.returns import (
    checked_decode,
    checked_figures,
    checked_images,
    checked_settings,
    checked_splats,
    checked_terms,
    untrained_notes,
)


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (None, "losses returned NoneType, expected scalar tensors by name."),
        (torch.ones(()), "losses returned Tensor, expected scalar tensors by name."),
        ({"l1": 0.5}, "losses returned float for 'l1', expected a scalar tensor."),
        (
            {"l1": torch.ones(2, 3)},
            "losses returned a tensor of shape [2, 3] for 'l1', expected a scalar tensor.",
        ),
    ],
)
def test_loss_terms_of_a_wrong_form_are_named(terms, message):
    with pytest.raises(ConfigError) as caught:
        checked_terms("losses", terms)
    assert caught.value.message == message
    assert caught.value.advice


def test_scalar_terms_and_none_at_all_are_sound():
    assert checked_terms("losses", {}) == {}
    assert list(checked_terms("losses", {"l1": torch.ones(())})) == ["l1"]


class Nameless(Refiner):
    def refine(self, context):
        return {}


class Named(Nameless):
    name = "named"


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (None, "refiners returned NoneType, expected a tuple of refiners."),
        (Named(), "refiners returned Named, expected a tuple of refiners."),
        ((None,), "refiners returned NoneType among its refiners."),
        ((Nameless(),), "the refiner Nameless has no name."),
    ],
)
def test_refiners_of_a_wrong_form_are_named(found, message):
    with pytest.raises(ConfigError) as caught:
        checked_refiners("refiners", found)
    assert caught.value.message == message
    assert caught.value.advice
    assert len(checked_refiners("refiners", [Named()])) == 1


class Fixed(Rasterizer):
    """Returns what it was given."""

    def __init__(self, output):
        self.output = output

    @classmethod
    def capabilities(cls):
        raise NotImplementedError

    def _render(self, splats, cameras, settings):
        return self.output


@pytest.mark.unchecked
def test_a_render_of_a_wrong_form_is_named():
    splats, cameras = random_splats(3), front_camera()
    statistics = RenderStatistics.zeros(splats.means, 1, frozenset())
    sound = RenderOutput(torch.zeros(1, 30, 40, 3), torch.zeros(1, 30, 40, 1), statistics)
    assert Fixed(sound).render(splats, cameras) is sound
    wrong = {
        "returned NoneType, expected RenderOutput.": None,
        "returned color of shape [30, 40, 3], expected [1, 30, 40, 3].": replace(
            sound, color=torch.zeros(30, 40, 3)
        ),
        "returned NoneType as alpha, expected a tensor.": replace(sound, alpha=None),
        "returned depth of shape [1, 30, 40, 3], expected [1, 30, 40, 1].": replace(
            sound, depth=torch.zeros(1, 30, 40, 3)
        ),
    }
    for message, output in wrong.items():
        with pytest.raises(ConfigError) as caught:
            Fixed(output).render(splats, cameras)
        assert caught.value.message == f"Fixed._render {message}"


@pytest.mark.unchecked
def test_splats_of_a_wrong_form_are_named_with_their_model():
    splats = random_splats(4)
    assert checked_splats("Mine.splats", splats, 4) is splats
    some = replace(splats.take(torch.arange(2)), rows=torch.tensor([3, 3]))
    assert checked_splats("Mine.splats", some, 4) is some
    flat = splats.opacities[:, None]
    wrong = {
        "returned tuple, expected Splats.": (splats.means, flat),
        "returned splats of a wrong form: splats.opacities: expected shape [4], found [4, 1].": (
            replace(splats, opacities=flat)
        ),
        "returned 2 splats for 4 rows.": replace(some, rows=None),
        "returned splats of a wrong form: splats.rows: expected shape [2], found [1].": replace(
            some, rows=some.rows[:1]
        ),
        "returned splats of a wrong form: splats.rows: expected a tensor of torch.int64, found "
        "torch.float32.": replace(some, rows=some.rows.float()),
        "returned splats of a wrong form: splats.opacities: expected a torch tensor, found "
        "NoneType; torch.as_tensor makes one.": replace(splats, opacities=None),
        "returned splats of a wrong form: splats.colors: expected a torch tensor, found "
        "NoneType; torch.as_tensor makes one.": replace(splats, colors=None),
        "returned splats of a wrong form: splats.means: expected shape [any, 3], found [].": (
            replace(splats, means=torch.zeros(()))
        ),
    }
    for message, found in wrong.items():
        with pytest.raises(ConfigError) as caught:
            checked_splats("Mine.splats", found, 4)
        assert caught.value.message == f"Mine.splats {message}"
        assert caught.value.advice


@pytest.mark.unchecked
@pytest.mark.parametrize(
    ("check", "found", "message"),
    [
        (checked_figures, 0.5, "returned float, expected numbers by name."),
        (
            checked_figures,
            {"error": torch.ones(())},
            "returned Tensor for 'error', expected a number.",
        ),
        (checked_images, {"error": 1}, "returned an image of int for 'error', expected [h, w, 3]."),
        (
            checked_images,
            {"error": torch.ones(1, 4, 4, 3)},
            "returned an image of shape [1, 4, 4, 3] for 'error', expected [h, w, 3].",
        ),
    ],
)
def test_other_returns_of_a_wrong_form_are_named(check, found, message):
    with pytest.raises(ConfigError) as caught:
        check("mine", found)
    assert caught.value.message == f"mine {message}"
    assert caught.value.advice


@pytest.mark.unchecked
def test_a_decoded_render_of_a_wrong_form_is_named():
    statistics = RenderStatistics.zeros(torch.zeros(1, 3), 1, frozenset())
    sound = RenderOutput(torch.zeros(1, 3, 4, 3), torch.zeros(1, 3, 4, 1), statistics)
    assert checked_decode("Mine.decode", sound, 1) is sound
    with pytest.raises(ConfigError, match="returned NoneType, expected RenderOutput"):
        checked_decode("Mine.decode", None, 1)
    with pytest.raises(ConfigError, match="returned NoneType as color, expected a tensor"):
        checked_decode("Mine.decode", replace(sound, color=None), 1)
    gray = replace(sound, color=sound.alpha)
    with pytest.raises(
        ConfigError, match=r"color of shape \[1, 3, 4, 1\], expected \[1, 3, 4, 3\]"
    ):
        checked_decode("Mine.decode", gray, 1)


@pytest.mark.unchecked
@pytest.mark.parametrize(
    ("group", "message"),
    [
        (lambda: None, "returned NoneType, expected a tuple of ParameterGroup."),
        (lambda: [("net", ())], "returned tuple, expected a ParameterGroup."),
        (
            lambda: [ParameterGroup("net", (("weight", torch.ones(1)),), LearningRate(0.1))],
            "returned tuple among the parameters of 'net', expected tensors.",
        ),
        (
            lambda: [ParameterGroup("net", (x for x in ()), LearningRate(0.1))],
            "returned generator as parameters of 'net', expected tuple.",
        ),
        (
            lambda: [ParameterGroup("net", (), 0.1)],
            "returned float as learning_rate of 'net', expected LearningRate.",
        ),
        (
            lambda: [ParameterGroup("dense", (), LearningRate(0.1))],
            "returned two groups, or a group and a column, of name 'dense'.",
        ),
    ],
)
def test_parameter_groups_of_a_wrong_form_are_named(group, message):
    model = MixedModel(3)
    model.parameter_groups = group
    with pytest.raises(ConfigError) as caught:
        Optimizer(model, Operators(), OptimizerSettings())
    assert caught.value.message == f"MixedModel.parameter_groups {message}"


def test_parameters_that_nothing_trains_are_listed():
    model = MixedModel(3)
    assert untrained_notes(model) == ()
    model.forgotten = torch.nn.Linear(2, 1, bias=False)
    model.fixed = torch.nn.Linear(2, 1).requires_grad_(False)
    (note,) = untrained_notes(model)
    assert note.startswith("not trained by gsfw: forgotten.weight of MixedModel, in no column")


def test_freezing_or_resetting_a_column_that_is_not_there_is_refused():
    optimizer = Optimizer(MixedModel(3), Operators(), OptimizerSettings())
    for call in (optimizer.freeze, optimizer.reset):
        with pytest.raises(
            ConfigError, match=r"(?s)'mean', which is no column .*There are dense, .*network"
        ):
            call(["mean"])


@pytest.mark.unchecked
def test_render_settings_of_a_wrong_form_are_named_with_their_method():
    method = SimpleNamespace(
        registered_as="method 'mine'", render_settings=lambda given, step: None
    )
    with pytest.raises(ConfigError) as caught:
        checked_settings(method, RenderSettings(), 3)
    message = "method 'mine': render_settings returned NoneType, expected RenderSettings."
    assert caught.value.message == message


def test_figures_of_numpy_are_plain_numbers():
    figures = checked_figures("mine", {"error": np.float32(0.5), "count": 3})
    assert figures == {"error": 0.5, "count": 3}
    assert [type(figure) for figure in figures.values()] == [float, int]
