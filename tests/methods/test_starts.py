"""What models of all methods start from."""

import pytest
from support.gaussians import toy_scene
from support.moving_splats import moving_scene

from gsfw.core.errors import ConfigError
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians4d.config import DeformationConfig
from gsfw.methods.rotor4d.config import SlicedGaussiansConfig
from gsfw.methods.spacetime.config import SpacetimeConfig

SCENES = {
    StaticGaussiansConfig: toy_scene,
    DeformationConfig: moving_scene,
    SlicedGaussiansConfig: moving_scene,
    SpacetimeConfig: moving_scene,
}


@pytest.mark.parametrize("config", SCENES)
def test_points_that_are_not_there_cannot_be_asked_for(config):
    method, scene = config(init="points").build(), SCENES[config]
    with pytest.raises(ConfigError) as caught:
        method.check_scene(scene(0))
    assert str(caught.value) == (
        "init=points: 'toy' brings 0 points, and none that can be used.\n"
        "Use init=dense, init=random, or give a splat file: init=FILE."
    )
    method.check_scene(scene(3))
