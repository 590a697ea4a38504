"""A model whose splats depend on the view is asked for those of one camera at a time."""

import pytest
import torch
from support.fast_rasterizer import fast_rasterizer
from support.memory_training import MemoryData, Recorder, camera, trainer, with_parts
from support.view_models import ByView

from gsfw.core.cameras import Cameras
from gsfw.core.loop.evaluation import render_model
from gsfw.core.loop.final_figures import final_figures
from gsfw.core.loop.rounded_model import RoundedModel
from gsfw.core.render_settings import RenderSettings
from gsfw.core.team import ALONE
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod

# Whole steps; the tests of their parts check shapes.
pytestmark = pytest.mark.unchecked


def test_each_view_of_a_step_gets_its_own_splats(tmp_path):
    run = trainer(tmp_path, "none", Recorder(), views_per_step=3, steps=2)
    model = ByView(run.parts.model)
    with_parts(run, rendered=model).fit()
    assert set(model.asked) == {1}
    assert len(model.asked) >= 2 * 3


def test_the_final_figures_tell_that_files_of_splats_are_without_the_view(tmp_path):
    run = trainer(tmp_path, "none", Recorder(), steps=1)
    assert "depends_on_view" not in final_figures(run, ALONE)
    by_view = with_parts(run, model=ByView(run.parts.model))
    assert final_figures(by_view, ALONE)["depends_on_view"] is True


def test_the_views_of_a_step_share_the_splats_of_other_models(tmp_path):
    run = trainer(tmp_path, "none", Recorder(), views_per_step=3, steps=2)
    model = ByView(run.parts.model)
    model.depends_on_view = False
    with_parts(run, rendered=model).fit()
    assert model.asked[:2] == [3, 3]


def test_losses_render_several_cameras_one_by_one(tmp_path):
    views = MemoryData().split
    several = Cameras.cat([camera for split in views.values() for camera in split.cameras])
    found = []

    class Watched(StaticGaussiansMethod):
        def losses(self, context):
            found.append(context.render(several, None).color.detach())
            found.append(
                torch.cat(
                    [
                        context.render(several.select([index]), None).color.detach()
                        for index in range(len(several))
                    ]
                )
            )
            return super().losses(context)

    run = trainer(tmp_path, "none", Recorder(), steps=1)
    method = Watched(StaticGaussiansConfig(sh_degree=1))
    with_parts(run, rendered=ByView(run.parts.model), method=method).fit()
    torch.testing.assert_close(found[0], found[1], rtol=0, atol=0)


def test_several_cameras_are_rendered_as_each_of_them(tmp_path):
    model = ByView(trainer(tmp_path, "none", Recorder()).parts.model)
    settings = RenderSettings(background=torch.zeros(3))
    cameras = [camera(index) for index in range(3)]
    together = render_model(model, fast_rasterizer(), Cameras.cat(cameras), settings)
    for index, one in enumerate(cameras):
        alone = render_model(model, fast_rasterizer(), one, settings).color[0]
        assert torch.equal(together.color[index], alone)
    assert together.statistics.visible.shape == (3, 0)
    assert not torch.equal(together.color[0], together.color[1])


def test_a_rounded_model_depends_on_the_view_as_its_model_does(tmp_path):
    plain = trainer(tmp_path, "none", Recorder()).parts.model
    for model in (plain, ByView(plain)):
        rounded = RoundedModel(model, lambda name, values: values.detach())
        assert rounded.depends_on_view == model.depends_on_view
