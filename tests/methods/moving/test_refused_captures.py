"""Captures of one time, which no method for moving scenes takes."""

import pytest
import torch
from support.moving_splats import moving_scene

from gsfw.commands.main import main
from gsfw.core.errors import ConfigError
from gsfw.methods.dynamic3d.config import TrackedGaussiansConfig
from gsfw.methods.gaussians4d.config import DeformationConfig
from gsfw.methods.rotor4d.config import SlicedGaussiansConfig
from gsfw.methods.spacetime.config import SpacetimeConfig

CONFIGS = {
    "4dgs": DeformationConfig,
    "4d-rotor": SlicedGaussiansConfig,
    "dynamic3dgs": TrackedGaussiansConfig,
    "spacetime": SpacetimeConfig,
}


@pytest.mark.parametrize("num_times", [0, 1])
@pytest.mark.parametrize("method", CONFIGS)
def test_a_capture_without_times_is_refused_with_advice(method, num_times):
    built = CONFIGS[method]().build()
    with pytest.raises(ConfigError) as caught:
        built.check_scene(moving_scene(num_times=num_times))
    assert str(caught.value) == (
        "this method is for captures of several times, and 'toy' has one.\n"
        "Use method=3dgs. If the scene does move, its data have to say when each image was "
        'taken, such as by "time" in every frame of a transforms.json; gsfw prepare VIDEO '
        "layout=transforms writes one. The built-in scene moves with datamanager.moving=true."
    )
    built.check_scene(moving_scene(camera_centers=torch.zeros(33, 3)))


@pytest.mark.parametrize("method", CONFIGS)
def test_data_without_times_are_refused_before_training(tmp_path, capsys, method):
    scene = ("datamanager.views=2", "datamanager.width=8", "datamanager.height=8")
    scene += ("datamanager.points=9", "datamanager.moving=false")
    assert main(["train", f"method={method}", *scene, f"out={tmp_path / 'run'}"]) != 0
    assert f"method '{method}' is for captures of several times" in capsys.readouterr().err
