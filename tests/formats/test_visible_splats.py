"""Splat files leave out what no renderer shows, and nothing else."""

from dataclasses import replace

import numpy as np
import torch
from support.scenes import front_camera, random_splats

from gsfw.core.exchange import SplatFile
from gsfw.core.render_settings import RenderSettings
from gsfw.formats.activation import logits_of
from gsfw.formats.visible_splats import without_invisible
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer

ALL = random_splats(60, degree=0)
FAINT = ALL.opacities.clone()
FAINT[::3] = 0.0039
FAINT[1] = 1 / 255


def test_what_is_left_out_changes_no_pixel():
    splats = replace(ALL, opacities=FAINT)
    content, count = without_invisible(SplatFile(splats))
    assert (count, len(content.splats)) == (20, 40)
    settings = RenderSettings(background=torch.ones(3))
    before, after = (
        ReferenceRasterizer().render(drawn, front_camera(32, 24), settings).color
        for drawn in (splats, content.splats)
    )
    assert torch.equal(before, after)


def test_a_file_of_visible_splats_is_the_same_file():
    content = SplatFile(replace(ALL, opacities=FAINT.clamp_min(0.5)))
    assert without_invisible(content) == (content, 0)


def test_an_opacity_of_one_byte_is_kept_after_rounding_to_a_logit():
    byte = torch.from_numpy(logits_of(np.array([1 / 255]))).double().sigmoid()
    assert float(byte) < 1 / 255
    content = SplatFile(replace(ALL, opacities=byte.expand(60)))
    assert without_invisible(content) == (content, 0)


def test_a_file_in_which_nothing_is_visible_keeps_everything():
    content = SplatFile(replace(ALL, opacities=torch.zeros_like(FAINT)))
    assert without_invisible(content) == (content, 0)


def test_opacities_that_are_none_are_left_for_the_format_to_refuse():
    wrong = FAINT.clone()
    wrong[4], wrong[5] = torch.nan, -0.1
    content, count = without_invisible(SplatFile(replace(ALL, opacities=wrong)))
    assert (count, len(content.splats)) == (20, 40)
    assert bool(content.splats.opacities.isnan().any() & (content.splats.opacities < 0).any())
