"""Frames: the views of a split with the images of their method."""

from types import SimpleNamespace

import pytest
from support.memory_training import Recorder, trainer, with_parts

from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.methods.gaussians3d.config import StaticGaussiansConfig
from gsfw.methods.gaussians3d.method import StaticGaussiansMethod
from gsfw.rendering.channels import CHANNELS
from gsfw.rendering.frames import FrameRenderer, FrameRule
from gsfw.rendering.pictures import PictureStyle


def test_images_of_a_method_that_are_of_no_image_shape_are_named(tmp_path):
    class Grey(StaticGaussiansMethod):
        def view_images(self, context):
            return {"alpha": context.rendered.alpha[0]}

    method = Grey(StaticGaussiansConfig())
    run = with_parts(trainer(tmp_path, "none", Recorder()), method=method)
    rule = FrameRule(PictureStyle((CHANNELS["color"],)))
    frames = FrameRenderer(SimpleNamespace(parts=run.parts, plan=run.plan), rule)
    with pytest.raises(ConfigError, match="Grey: view_images returned an image"):
        frames.images_of_view(Split.EVAL, 0)
