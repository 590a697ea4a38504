"""Subject: images of a model in the type of its variant."""

from dataclasses import replace

import torch
from support.moving_splats import at, spacetime
from support.scenes import front_camera

from gsfw.core.render_settings import RenderSettings
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.tradeoff.subject import Subject


def test_features_that_are_rendered_in_float64_are_decoded_by_a_network_in_float32():
    model = spacetime(colors="features").float()
    plain = Subject(model, ReferenceRasterizer(), RenderSettings(), is_still=False)
    double = replace(plain, dtype=torch.float64)
    images = [one.image(one.splats(at(0.4)), front_camera()) for one in (plain, double)]
    torch.testing.assert_close(*images)
