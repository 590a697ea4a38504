"""Tests of gsfw.core.returns: what parts return in a wrong form is named, with the remedy."""

from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.errors import ConfigError
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.refinement.refiners import checked_refiners
from gsfw.core.refiner import Refiner
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.returns import checked_terms


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
