"""The opacity penalty: off by default, one term in the loss, in every method with Gaussians."""

import pytest
import torch
from support.gaussians import no_contributions, no_views
from support.scenes import front_camera, random_splats

from gsfw.core.batch import Batch
from gsfw.core.context import StepContext
from gsfw.core.errors import ConfigError
from gsfw.core.operators import Operators
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.methods.dynamic3d.config import TrackedGaussiansConfig
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.opacity_penalty import OpacityPenalty
from gsfw.methods.spacetime.config import SpacetimeConfig


def test_it_is_the_weighted_mean_opacity():
    splats, image = random_splats(4), torch.zeros(1, 12, 16, 3)
    statistics = RenderStatistics(torch.ones(1, 4, dtype=torch.bool), torch.ones(1, 4))
    context = StepContext(
        step=0, steps=10, batch=Batch(image, front_camera(16, 12), (0,)), splats=splats,
        rendered=RenderOutput(image, torch.ones(1, 12, 16, 1), statistics), target=image,
        num_rows=4, share=1.0, extent=1.0, operators=Operators(),
        render=no_views, contributions=no_contributions,
    )  # fmt: skip
    terms = OpacityPenalty(0.5).regularizers(context)
    assert set(terms) == {"opacity_penalty"}
    torch.testing.assert_close(terms["opacity_penalty"], 0.5 * splats.opacities.mean())


@pytest.mark.parametrize("settings", [{}, {"opacity_penalty": 0.03}])
def test_a_method_has_it_only_with_a_weight(settings):
    found = StaticGaussiansConfig(**settings).build().penalties()
    assert [type(each) for each in found] == [OpacityPenalty] * len(settings)


@pytest.mark.parametrize("config", [SpacetimeConfig, TrackedGaussiansConfig])
def test_moving_methods_have_it_too(config):
    method = config(opacity_penalty=0.1).build()
    (found,) = method.canonical.penalties()
    assert isinstance(found, OpacityPenalty)


def test_a_negative_weight_is_refused():
    with pytest.raises(ConfigError, match=r"opacity_penalty=-1: expected a finite number"):
        StaticGaussiansConfig(opacity_penalty=-1.0).check()
