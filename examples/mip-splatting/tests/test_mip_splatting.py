"""Mip-Splatting trains, keeps its filter current, and conserves what a Gaussian contributes."""

import subprocess
import sys

import pytest
import torch
from gsfw_mip_splatting.sampling import SamplingRates

from gsfw.api import Cameras, RenderSettings, Split, open_run
from gsfw.testing import conformance

test_conforms = conformance("plugin", "gsfw-mip-splatting")

SCENE = (
    *("datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=48"),
    *("datamanager.height=36", "datamanager.points=300", "device=cpu", "report=false"),
)


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """A run of 60 steps with density control, opened again."""
    out = tmp_path_factory.mktemp("mip") / "run"
    grows = ("strategy.refine_start=10", "strategy.refine_every=10", "filter_every=20")
    command = (
        *(sys.executable, "-m", "gsfw", "train", "method=mip-splatting", f"out={out}"),
        *("steps=60", "rescale=false"),
    )
    subprocess.run([*command, *SCENE, *grows], check=True, capture_output=True)
    return open_run(out)


def camera(depth, focal=100.0):
    pose = torch.eye(4)
    pose[2, 3] = depth
    matrix = torch.tensor([[focal, 0.0, 32.0], [0.0, focal, 24.0], [0.0, 0.0, 1.0]])
    return Cameras(pose[None], matrix[None], 64, 48)


def test_the_rate_is_the_largest_focal_length_over_depth_of_all_cameras_that_see_a_point():
    points = torch.tensor([[0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [50.0, 0.0, 0.0]])
    rates = SamplingRates([camera(4.0), camera(2.0)]).of(points)
    # The second point is outside the nearer image, the third outside both.
    assert torch.allclose(rates, torch.tensor([50.0, 25.0, 25.0]))


def test_the_filter_follows_edits_of_rows_and_its_schedule(opened):
    model, views = opened.model, opened.data.views(Split.TRAIN)
    found = model.extra["filter"].values
    expected = 0.2**0.5 / SamplingRates(views.cameras).of(model.means.values.detach())
    assert len(found) == model.num_rows != 300
    assert torch.allclose(found, expected, rtol=1e-4)


def test_smoothing_keeps_the_integral_of_each_gaussian(opened):
    model = opened.model
    with torch.no_grad():
        smooth = model.splats()
        plain = model.opacity_logits.values.sigmoid() * model.log_scales.values.exp().prod(1)
    assert bool((smooth.scales >= model.extra["filter"].values[:, None]).all())
    assert torch.allclose(smooth.opacities * smooth.scales.prod(1), plain, rtol=1e-4)


def test_a_reset_of_opacities_concerns_those_that_are_rendered(opened):
    model = opened.model
    before = model.splats().opacities.detach().clone()
    model.change_opacities_(lambda opacities: opacities.clamp(max=0.05))
    after = model.splats().opacities.detach()
    assert float(before.max()) > 0.06
    assert float(after.max()) < 0.0501
    assert torch.equal(after[before < 0.049], before[before < 0.049])


def test_renders_use_the_2d_filter_of_the_paper(opened):
    settings = opened.method.render_settings(RenderSettings(antialias=True), None)
    assert settings.profile.dilation == 0.1
