"""Frames: what a page shows is what the rasterizer renders."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import torch
from support.view_models import ByView
from support.viewing import FixedSplats, OneView, captured_model, moving_model, still_model

from gsfw.core.batch import MaskMode
from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.loop.evaluation import render_model
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.viewer.arrangement import beside, fitted, slots, wiped
from gsfw.viewer.frame import FrameMaker
from gsfw.viewer.shown_model import edited, inside, shown
from gsfw.viewer.view_state import Box, CapturedView, Comparison, Pose, ViewState
from gsfw.viewer.viewed_model import same_world

FRONT = Pose((0.0, 0.0, -4.0), (1.0, 0.0, 0.0, 0.0), 0.8)
STATE = ViewState(pose=FRONT, width=48, height=36)
VIEW = CapturedView(Split.TRAIN, 0)


def test_a_frame_is_the_render_of_the_camera_of_the_page():
    model = still_model()
    frame = FrameMaker([model]).make(STATE)
    camera = FRONT.cameras(48, 36)
    wanted = render_model(model.model, model.rasterizer, camera, model.settings).color[0]
    assert np.array_equal(frame.image, (wanted.clamp(0, 1) * 255).round().byte().numpy())


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_frame_has_the_splats_of_its_camera(scale):
    plain = still_model()
    model = replace(plain, model=ByView(plain.model))
    state = replace(STATE, splat_scale=scale)
    assert shown(model.model, state).depends_on_view
    found = FrameMaker([model]).make(state).image
    assert set(model.model.asked) == {1}
    assert (found != FrameMaker([plain]).make(state).image).any()


def test_a_pose_survives_its_camera():
    pose = Pose((0.3, -0.2, 1.5), (0.5, 0.5, -0.5, 0.5), 0.7)
    back = Pose.of(pose.cameras(40, 30))
    assert np.allclose(back.position, pose.position, atol=1e-6)
    assert np.allclose(back.wxyz, pose.wxyz, atol=1e-6)
    assert back.fov == pytest.approx(pose.fov, abs=1e-6)


def test_a_frame_of_half_the_side_has_the_same_view():
    frame = FrameMaker([still_model()]).make(STATE, 0.5)
    assert frame.image.shape == (18, 24, 3)


def test_frames_are_no_higher_than_the_page_asks_for():
    assert ViewState(width=1600, height=900, full_height=450).full_size() == (800, 450)
    assert ViewState(width=160, height=90, full_height=450).full_size() == (160, 90)


def test_time_moves_what_moves():
    maker = FrameMaker([moving_model()])
    first, last = (maker.make(replace(STATE, time=time)).image for time in (0.0, 1.0))
    assert (first != last).any()


def test_a_background_shows_where_nothing_is():
    frame = FrameMaker([still_model(count=1)]).make(replace(STATE, background=(1.0, 0.0, 0.0)))
    assert frame.image[0, 0].tolist() == [255, 0, 0]


@pytest.mark.parametrize("channel", ["depth", "alpha", "count", "contribution", "sh_degree"])
def test_channels_of_values_say_what_their_colours_mean(channel):
    frame = FrameMaker([still_model()]).make(replace(STATE, channel=channel))
    assert frame.scale is not None
    assert frame.scale.low < frame.scale.high


def test_a_captured_view_beside_its_photo_and_its_error_has_a_figure():
    state = replace(STATE, width=240, height=60, view=VIEW, comparison=Comparison.SIDE_BY_SIDE)
    frame = FrameMaker([captured_model()]).make(state)
    assert frame.image.shape == (60, 240, 3)
    assert frame.image[30, 40].tolist() == [128, 128, 128]  # The photo is the left third.
    assert frame.psnr is not None
    assert frame.psnr_size == (32, 24)  # As in the evaluation, though the page is larger.


def test_a_view_that_its_mask_hides_has_no_figure():
    class Hidden(OneView):
        def load(self, split, indices, device):
            (batch,) = super().load(split, indices, device)
            nothing = torch.zeros(1, 24, 32, 1, dtype=torch.bool)
            return [replace(batch, mask=nothing, mask_mode=MaskMode.IGNORE)]

    model = replace(captured_model(), data=Hidden((0.5, 0.5, 0.5)))
    assert FrameMaker([model]).make(replace(STATE, view=VIEW)).psnr is None


def test_the_photo_alone_fills_the_page_in_its_own_shape():
    state = replace(STATE, width=96, height=36, view=VIEW, comparison=Comparison.OTHER)
    image = FrameMaker([captured_model()]).make(state).image
    assert (image[:, 24:72] == 128).all()
    assert (image[:, :20] < 30).all()


def test_a_wipe_has_the_photo_at_the_left_and_the_render_at_the_right():
    state = replace(STATE, width=48, height=36, view=VIEW, comparison=Comparison.WIPE, wipe=0.5)
    maker = FrameMaker([captured_model()])
    image = maker.make(state).image
    render = maker.make(replace(state, comparison=Comparison.RENDER)).image
    assert (image[:, :22] == 128).all()
    assert np.array_equal(image[:, 26:], render[:, 26:])


def test_the_error_of_a_free_view_is_its_colours_as_there_is_no_photo():
    maker = FrameMaker([captured_model()])
    free, plain = (maker.make(replace(STATE, channel=name)) for name in ("error", "color"))
    assert np.array_equal(free.image, plain.image)


def test_two_runs_stand_beside_one_another():
    first, second = still_model("a"), still_model("b", seed=1)
    state = replace(STATE, width=98, comparison=Comparison.SIDE_BY_SIDE)
    both = FrameMaker([first, second]).make(state).image
    for model, part in ((first, both[:, :48]), (second, both[:, -48:])):
        alone = FrameMaker([model]).make(STATE).image
        assert np.array_equal(part, alone)


def two_runs_of_one_world():
    """The same splats in two frames: the second one is turned, shifted, and twice as large."""
    first = captured_model()
    turn = rotation_matrices(torch.tensor([[0.9, 0.1, 0.3, 0.2]], dtype=torch.float64))[0]
    placed = Similarity(0.5, turn, torch.tensor([0.3, -0.2, 0.1], dtype=torch.float64))
    splats = transform_splats(first.model.splats(), placed.inverse()).map(torch.Tensor.float)
    data = OneView((0.5, 0.5, 0.5), placed)
    second = replace(first, name="second", model=FixedSplats(splats), scene=data.scene, data=data)
    return first, second


def test_two_runs_of_other_frames_are_cropped_by_one_box():
    crop = Box((-0.4, -2.0, -2.0), (2.0, 2.0, 0.3))
    state = replace(STATE, width=98, comparison=Comparison.SIDE_BY_SIDE, crop=crop)
    image = FrameMaker(two_runs_of_one_world()).make(state).image.astype(int)
    whole = FrameMaker(two_runs_of_one_world()).make(replace(state, crop=None)).image
    assert np.abs(image[:, :48] - image[:, -48:]).max() <= 2
    assert np.abs(image - whole).max() > 20  # The box does cut something off.


@pytest.mark.parametrize("channel", ["depth", "count"])
def test_two_runs_share_one_scale_of_values(channel):
    state = replace(STATE, width=98, comparison=Comparison.SIDE_BY_SIDE, channel=channel)
    image = FrameMaker(two_runs_of_one_world()).make(state).image.astype(int)
    assert (np.abs(image[:, :48] - image[:, -48:]).max(2) > 4).mean() < 0.01


def test_runs_show_one_world_if_a_view_of_both_was_taken_at_one_place():
    first, _ = two_runs_of_one_world()
    elsewhere = replace(first, data=OneView((0.0, 0.0, 0.0), name="other.png"))
    shift = Similarity(translation=torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64))
    shifted = OneView((0.0, 0.0, 0.0), shift)
    assert same_world(first, first)
    assert not same_world(first, elsewhere)
    assert not same_world(first, replace(first, data=shifted, scene=shifted.scene))
    assert not same_world(first, still_model())


def test_a_light_page_has_light_margins():
    state = replace(STATE, width=96, view=VIEW, comparison=Comparison.OTHER, behind=0.9)
    assert (FrameMaker([captured_model()]).make(state).image[:, :20] > 220).all()


def test_a_motion_channel_of_what_stands_still_is_refused_in_words():
    with pytest.raises(ConfigError, match="changes with time"):
        FrameMaker([still_model()]).make(replace(STATE, channel="motion"))


def test_a_crop_keeps_the_gaussians_inside_and_their_rows():
    model = still_model().model
    box = Box((-1.0, -1.0, -1.0), (0.0, 1.0, 1.0))
    kept = edited(model.splats(), replace(STATE, crop=box))
    assert 0 < len(kept) < 40
    assert bool(inside(kept.means, box).all())
    assert torch.equal(kept.means, model.splats().means[kept.rows])


def test_smaller_gaussians_and_fewer_bands_change_nothing_in_the_model():
    model = still_model().model
    before = model.splats()
    small = edited(before, replace(STATE, splat_scale=0.1, sh_degree=0))
    assert torch.allclose(small.scales, 0.1 * before.scales)
    assert small.colors.degree == 0
    assert before.colors.degree == 1


def test_images_of_any_width_have_slots_that_fill_it():
    for width, count in product((7, 96, 101), (1, 2, 3)):
        parts = [torch.zeros(4, size[0], 3) for size in slots(width, 4, count)]
        assert beside(parts, 0.0).shape == (4, width, 3)


def test_an_image_fits_inside_in_its_own_shape():
    assert fitted(200, 100, (50, 50)) == (50, 25)
    assert fitted(100, 200, (50, 50)) == (25, 50)


def test_a_wipe_at_either_end_shows_one_image_without_a_line():
    black, white = torch.zeros(4, 9, 3), torch.ones(4, 9, 3)
    assert torch.equal(wiped(black, white, 0.0), white)
    assert torch.equal(wiped(black, white, 1.0), black)
