"""Guided sampling on images of which one patch is wrong."""

from dataclasses import replace

import pytest
import torch
from support.gaussians import EXTENT, context_of, gaussians, table_of, toy_scene
from support.refining import StrategyRun
from support.resuming import resumes_to_the_same_bits
from support.scenes import front_camera
from support.states import assert_same_bits

from gsfw.core.batch import Batch, MaskMode
from gsfw.core.cameras import CameraModel
from gsfw.core.capabilities import Feature
from gsfw.core.maths.spherical_harmonics import dc_to_rgb
from gsfw.core.refiner import GrowthLimits, RefineContext
from gsfw.core.render_output import RenderOutput, RenderStatistics
from gsfw.core.render_settings import Depth
from gsfw.core.scene import Scene
from gsfw.strategies.adc import AdcConfig
from gsfw.strategies.guided_sampling import (
    DEPTHS,
    SIZE,
    GuidedSampling,
    GuidedSamplingConfig,
    bounding_box,
)
from gsfw.strategies.rounds import RefinementRounds

CONFIG = GuidedSamplingConfig(rounds=2, start=10, every=5, share=1e-3)
"""Of the 12 patches of an image the worst one gets rows."""
RED = torch.tensor([0.9, 0.2, 0.1])
CAMERA = replace(front_camera(64, 48), time=torch.tensor([0.7]))
"""At z = -4, looking along z; its focal length is 76.8 pixels."""
CENTER = torch.tensor([(40 - 32) / 76.8, (24 - 24) / 76.8, 1.0])
"""Ray through the centre of the patch in the second row and the third column, at depth 1."""


def guided(config=CONFIG, scene=None):
    return GuidedSampling(config, scene or toy_scene(), RefinementRounds(0, 1, 1000))


def image(view=0, error=1.0, depth=3.0, drawn=1.0, step=9, camera=CAMERA, **batch):
    """A context whose view should be red in the patch at row 1 and column 2, and is black."""
    target = torch.zeros(1, 48, 64, 3)
    target[:, 16:32, 32:48] = error * RED
    seen = RenderStatistics.zeros(torch.zeros(4, 3), 1, frozenset())
    context = context_of(seen, 4, step)
    return replace(
        context,
        batch=Batch(target, camera, (view,), **batch),
        rendered=RenderOutput(
            torch.zeros_like(target),
            torch.full((1, 48, 64, 1), drawn),
            seen,
            depth=torch.full((1, 48, 64, 1), depth),
        ),
        target=target,
    )


def look_at(sampling, context):
    """Let a view be observed."""
    sampling.observe(context, context.rendered.statistics, gaussians(4))


def added(sampling, done=10, model=None, max_rows=0, seed=0):
    """What a refinement adds: rows by column, and what it says."""
    model = gaussians(4) if model is None else model
    _, table = table_of(model)
    generator = torch.Generator().manual_seed(seed)
    limits = GrowthLimits(max_rows=max_rows or None)
    edits: dict[str, int] = {}
    context = RefineContext(done - 1, 100, table, model, generator, limits, True, edits)
    counts = sampling.refine(context)
    columns = {name: column.values.detach() for name, column in model.columns().items()}
    return {name: values[4:] for name, values in columns.items()}, counts


def test_rows_come_along_the_ray_of_the_worst_patch_around_the_surface_in_its_colour():
    sampling = guided()
    look_at(sampling, image())
    rows, counts = added(sampling)
    assert counts == {"guided": DEPTHS}
    offsets = rows["means"] - torch.tensor([0.0, 0, -4])
    depths = offsets[:, 2:]
    torch.testing.assert_close(offsets / depths, CENTER.repeat(DEPTHS, 1))
    edges = 2.7 + 0.6 * torch.arange(DEPTHS + 1) / DEPTHS
    assert bool((depths[:, 0] >= edges[:-1]).all())
    assert bool((depths[:, 0] <= edges[1:]).all())
    torch.testing.assert_close(dc_to_rgb(rows["sh_dc"][:, 0]), RED.repeat(DEPTHS, 1))
    torch.testing.assert_close(rows["opacity_logits"].sigmoid(), torch.full((DEPTHS,), 0.1))


def test_a_row_is_as_large_as_its_patch_is_there():
    sampling = guided()
    look_at(sampling, image())
    rows, _ = added(sampling)
    width = 16 / 76.8 * (rows["means"][:, 2] + 4)
    torch.testing.assert_close(rows["log_scales"][:, 0].exp(), SIZE * width, rtol=0.1, atol=0)


def test_parallel_rays_have_patches_of_one_size():
    intrinsics = torch.tensor([[[16.0, 0, 32], [0, 16, 24], [0, 0, 1]]])
    camera = replace(CAMERA, model=CameraModel.ORTHOGRAPHIC, intrinsics=intrinsics)
    sampling = guided()
    look_at(sampling, image(camera=camera))
    rows, _ = added(sampling)
    torch.testing.assert_close(rows["means"][:, :2], torch.tensor([[0.5, 0.0]]).repeat(DEPTHS, 1))
    torch.testing.assert_close(rows["log_scales"].exp(), torch.full((DEPTHS, 3), SIZE))


def test_where_nothing_is_drawn_rows_are_between_the_camera_and_the_far_side_of_the_box():
    points = torch.rand(1000, 3, generator=torch.Generator().manual_seed(0)) - 0.5
    points[0] = 1e6  # An outlier.
    scene = Scene("toy", points, points.clone(), torch.tensor([[0.0, 0, -4]]), EXTENT)
    low, high = bounding_box(scene)
    torch.testing.assert_close(low, torch.tensor([-0.5, -0.5, -4]), atol=0.03, rtol=0)
    torch.testing.assert_close(high, torch.tensor([0.5, 0.5, 0.5]), atol=0.03, rtol=0)
    sampling = guided(scene=scene)
    look_at(sampling, image(drawn=0.4))
    rows, _ = added(sampling)
    depths = rows["means"][:, 2] + 4
    assert bool((depths.diff() > 0).all())
    assert 0.2 < float(depths[0]) < 1.5
    assert 3.0 < float(depths[-1]) <= 4.5


def test_a_scene_without_points_reaches_an_extent_beyond_its_cameras():
    low, high = bounding_box(toy_scene(camera_centers=torch.zeros(2, 3)))
    assert (low.tolist(), high.tolist()) == ([-EXTENT] * 3, [EXTENT] * 3)


def test_the_two_views_with_the_largest_errors_are_used_and_not_again_until_drawn_again():
    sampling = guided(replace(CONFIG, rounds=4))
    for view, error in enumerate((0.1, 0.4, 0.2, 0.3)):
        look_at(sampling, image(view, error))
    assert added(sampling)[1] == {"guided": 2 * DEPTHS}
    assert sorted(sampling.state_dict()["seen"]) == [0, 2]
    assert added(sampling, 15)[1] == {"guided": 2 * DEPTHS}
    assert added(sampling, 20)[1] == {"guided": 0}
    look_at(sampling, image(1, 0.4))
    assert added(sampling, 25)[1] == {"guided": DEPTHS}


def test_rounds_are_as_many_and_as_far_apart_as_asked_for():
    sampling = guided()
    said = []
    for done in range(1, 40):
        look_at(sampling, image(step=done - 1))
        said.append(added(sampling, done)[1])
    assert [done for done, counts in enumerate(said, 1) if counts] == [10, 15]
    assert sampling.state_dict() == {"rounds": 2, "seen": {}}


def test_images_are_looked_at_from_an_interval_before_the_first_round_until_the_last():
    sampling = guided()
    assert next(step for step in range(20) if sampling.depth(step) is Depth.EXPECTED) == 5
    look_at(sampling, image(step=4))
    assert sampling.state_dict()["seen"] == {}
    assert sampling.depth(998) is Depth.EXPECTED
    assert sampling.depth(999) is Depth.NONE, "no refinement follows"
    added(sampling, 10)
    added(sampling, 15)
    assert sampling.depth(16) is Depth.NONE
    assert guided(GuidedSamplingConfig()).depth(2000) is Depth.NONE


def test_new_rows_are_at_the_time_of_their_view():
    model = gaussians(4)
    asked = []
    plain = model.rows_at

    def rows_at(points, colors, sizes, time):
        asked.append(time)
        return plain(points, colors, sizes, time)

    model.rows_at = rows_at
    sampling = guided()
    look_at(sampling, image(0))
    look_at(sampling, image(1, error=0.5, camera=replace(CAMERA, time=None)))
    added(sampling, model=model)
    assert asked == [pytest.approx(0.7), None]


@pytest.mark.parametrize(
    "batch",
    [
        {"mask": torch.zeros(1, 48, 64, 1, dtype=torch.bool)},
        {"mask": torch.zeros(1, 48, 64, 1, dtype=torch.bool), "mask_mode": MaskMode.EMPTY},
        {"alpha": torch.zeros(1, 48, 64, 1)},
    ],
    ids=["invalid", "empty", "transparent"],
)
def test_what_carries_no_loss_or_is_background_gets_no_rows(batch):
    sampling = guided(replace(CONFIG, share=1.0))
    look_at(sampling, image(**batch))
    assert added(sampling)[1] == {"guided": 0}


def test_an_image_that_is_not_finite_gets_no_rows_that_are_not():
    sampling = guided(replace(CONFIG, share=1.0))
    context = image()
    broken = torch.full_like(context.rendered.color, torch.nan)
    look_at(sampling, replace(context, rendered=replace(context.rendered, color=broken)))
    assert added(sampling)[1] == {"guided": 0}


def test_the_share_of_patches_and_the_limit_of_rows_are_kept():
    def rows(share, max_rows):
        sampling = guided(replace(CONFIG, share=share))
        context = image()
        target = context.target + torch.rand(1, 48, 64, 3, generator=torch.Generator())
        look_at(sampling, replace(context, target=target))
        return added(sampling, max_rows=max_rows)[1]["guided"]

    assert rows(0.5, 0) == 6 * DEPTHS
    assert rows(1.0, 0) == 12 * DEPTHS
    assert rows(1.0, 4 + 5 * DEPTHS + 1) == 5 * DEPTHS
    assert rows(1.0, 3) == 0


def test_a_restored_one_adds_the_same_rows():
    sampling, other = guided(), guided()
    for view, error in enumerate((0.4, 0.6)):
        look_at(sampling, image(view, error))
    other.load_state_dict(sampling.state_dict())
    assert_same_bits(other.state_dict(), sampling.state_dict())
    assert_same_bits(added(other), added(sampling))
    assert added(other, 15)[1] == added(sampling, 15)[1]


def test_it_is_a_part_of_adc_that_is_off_by_default():
    off = AdcConfig()
    assert off.needs().features == {Feature.SCREEN_GRADIENT}
    assert "guided" not in StrategyRun(off).state_dict()
    on = AdcConfig(refine_start=0, refine_every=10, refine_stop=100, guided=CONFIG)
    assert on.needs().features == {Feature.SCREEN_GRADIENT, Feature.DEPTH}
    adc, model = StrategyRun(on), gaussians(4)
    assert adc.depth(9) is Depth.EXPECTED
    context = image()
    adc.observe(context, context.rendered.statistics, model)
    other = StrategyRun(on)
    other.load_state_dict(adc.state_dict())
    assert_same_bits(other.state_dict(), adc.state_dict())
    _, table = table_of(model)
    counts = adc.edit(9, table, model, torch.Generator().manual_seed(0))
    assert counts == {"cloned": 0, "split": 0, "pruned": 0, "guided": DEPTHS}
    assert len(table) == 4 + DEPTHS
    adc.observe(image(step=12), context.rendered.statistics, model)
    assert list(adc.state_dict()["guided"]["seen"]) == [0]
    adc.edit(99, table, model, torch.Generator())
    assert adc.state_dict()["guided"]["seen"] == {}, "after the last refinement there is no round"


@pytest.mark.slow
@pytest.mark.parametrize("method", ["spacetime", "4dgs"])
def test_a_run_resumes_to_the_same_bits_between_two_rounds(tmp_path, method):
    guided = ("strategy.guided.rounds=2", "strategy.guided.start=6", "strategy.guided.every=8")
    often = ("strategy.refine_start=0", "strategy.refine_every=2", "strategy.refine_stop=20")
    still = (
        "strategy.grow_gradient=1",
        "strategy.grow_time_gradient=0",
        "strategy.prune_opacity=0",
    )
    arguments = (f"method={method}", "strategy=adc", *often, *still, *guided)
    summary = resumes_to_the_same_bits(tmp_path, *arguments)
    assert summary["num_gaussians"] == 150 + 2 * 2 * DEPTHS, "two rounds of two views"
