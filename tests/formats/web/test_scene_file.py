"""The file of the web player: errors within its steps, and the important splats first."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from support.web_scenes import ORIGIN, WithPreview, at_time, ball, cameras, moving_ball, read_scene

from gsfw.core.exchange import Motion, MotionFile, Preview, SplatFile
from gsfw.core.maths.spherical_harmonics import C0
from gsfw.core.splats import Sh
from gsfw.formats.web import scene_file as written
from gsfw.formats.web.scene_file import importance_order, scene_file
from gsfw.formats.web.shown import Shown

FLOAT24 = 2.0**-16
"""Relative error of float24: half of its last of 15 bits."""


def stored(source, degree=4, background=""):
    return b"".join(scene_file(Shown.of(source, "", background, degree, metre=0.0)))


def in_order(content):
    return content.content.splats.take(importance_order(content))


def test_a_file_holds_every_value_within_half_a_step():
    content = ball(degree=3).motion_file()
    read, given = read_scene(stored(content)), in_order(content)
    header = read.header
    offsets = given.means - torch.tensor(header["origin"])
    assert ((read.splats.means - given.means).abs() <= offsets.abs() * FLOAT24 + 1e-12).all()
    assert (read.splats.opacities - given.opacities).abs().max() <= 0.5 / 255 + 1e-6
    logs = (read.splats.scales.log() - given.scales.log()).abs()
    assert logs.max() <= header["scale_step"] / 2 + 1e-6
    before, after = given.colors.dense().double(), read.splats.colors.dense()
    assert (before - after)[:, 0].abs().max() * C0 <= header["color_step"] / 2 + 1e-6
    assert (before - after)[:, 1:].abs().max() <= header["sh_step"] / 2 + 1e-6


def test_a_rotation_is_off_by_less_than_a_third_of_a_degree():
    content = ball().motion_file()
    read, given = read_scene(stored(content)), in_order(content)
    same = (read.splats.quats * given.quats).sum(1).abs().clamp(max=1)
    # Three components are off by half a step at most. The largest, which is 1/2 at least, is off by
    # sqrt(3) times as much as the three together.
    three = np.sqrt(3) * np.sqrt(0.5) / 511 / 2
    farthest = 2 * three * np.sqrt(1 + 3)
    assert (2 * same.acos()).max() <= farthest + 1e-6
    assert farthest < np.radians(1 / 3)


def test_a_moving_file_holds_motions_without_infinities():
    content = moving_ball()
    read = read_scene(stored(content))
    assert read.header["moving"]
    assert read.header["time_range"] == [2.0, 6.0]
    order = importance_order(content)
    motion = content.motion
    width = motion.width[order].numpy()
    assert np.allclose(read.motion[:, 0], motion.center[order], rtol=FLOAT24)
    assert np.allclose(read.motion[:, 1], 1 / width, rtol=FLOAT24)
    assert set(read.motion[:, 2]) == {-1.0, 0.5}
    assert set(read.motion[:, 3]) == {0.5, 2.0}
    assert np.allclose(read.motion[:, 4:13], motion.path[order].flatten(1), rtol=FLOAT24)
    quats = content.content.splats.quats[order]
    sign = (quats * read.splats.quats).sum(1, keepdim=True).sign()
    assert np.allclose(read.motion[:, 13:17], motion.spin[order] * sign, rtol=FLOAT24)
    assert np.allclose(read.motion[:, 17:], motion.growth[order], rtol=FLOAT24)


def test_a_splat_turned_by_90_degrees_spins_with_the_sign_of_its_stored_rotation():
    # Two components tie in float32, of which the other is larger in float64.
    half = np.sqrt(0.5)
    quats = torch.tensor([[np.nextafter(half, 0), 0, 0, -half]], dtype=torch.float64)
    given = ball(1)
    given = replace(given, splats=replace(given.splats, quats=quats))
    spin = torch.tensor([[0.1, 0.2, 0.3, 0.4]], dtype=torch.float64)
    motion = replace(Motion.none(1), spin=spin)
    read = read_scene(stored(MotionFile(given, motion, (0.0, 1.0), frames=2)))
    sign = (quats * read.splats.quats).sum(1, keepdim=True).sign()
    assert np.allclose(read.motion[:, 13:17], spin * sign, rtol=FLOAT24)


def test_a_splat_far_away_costs_the_others_no_precision():
    content = ball()
    content.splats.means[7] += 1e7
    read, given = read_scene(stored(content)), in_order(content.motion_file())
    near = (given.means - ORIGIN).norm(dim=1) < 2
    assert (read.splats.means - given.means)[near].abs().max() < 2 * FLOAT24


def test_the_most_important_blocks_come_first(monkeypatch):
    monkeypatch.setattr(written, "BLOCK", 512)
    content = ball(count=2000)
    content.splats.opacities[:500] = 5e-3
    read = read_scene(stored(content))
    assert (read.splats.opacities[-464:] < 0.01).all()
    assert (read.splats.opacities[:1024] > 0.01).all()
    assert read.header["block"] == 512


def test_a_splat_that_is_there_for_a_moment_comes_later(monkeypatch):
    monkeypatch.setattr(written, "BLOCK", 8)
    content = moving_ball(count=16)
    splats = content.content.splats
    assert splats.scales is not None
    alike = replace(
        splats, scales=torch.ones_like(splats.scales), opacities=torch.ones_like(splats.opacities)
    )
    still, rows = Motion.none(16), torch.arange(16)
    brief = replace(still, width=torch.where(rows < 8, 0.01, still.width))
    order = importance_order(replace(content, content=SplatFile(alike), motion=brief))
    assert set(order[:8].tolist()) == set(range(8, 16))


@pytest.mark.parametrize("degree", [0, 1, 2, 3, 4])
def test_every_degree_can_be_written_and_cut_down(degree):
    content = ball(count=300, degree=4)
    read = read_scene(stored(content, degree))
    assert read.header["degree"] == degree
    assert read.splats.colors.dense().shape[1] == (degree + 1) ** 2


def test_splats_at_rest_that_nobody_sees_are_left_out():
    content = ball(count=100)
    content.splats.opacities[:10] = 1 / 300
    assert len(read_scene(stored(content)).splats) == 90


def test_equal_scenes_give_equal_bytes():
    assert stored(ball(count=300)) == stored(ball(count=300))


def test_the_header_says_where_visitors_begin():
    views = cameras(2)
    preview = Preview("ball", views, target=ORIGIN)
    source = WithPreview(ball(count=50).motion_file(), preview)
    header = read_scene(stored(source, background="1,0.5,0")).header
    assert header["background"] == [1.0, 0.5, 0.0]
    assert header["target"] == ORIGIN.tolist()
    assert header["up"] == "z"
    first = header["views"][0]
    assert np.allclose(first["world_to_camera"], views.world_to_camera[0])
    assert first["size"] == [320, 240]
    assert first["lens"][2] == 320 / 2 + 11.5


def test_large_values_widen_the_steps_instead_of_being_cut_off():
    content = ball(count=200)
    content.splats.colors.coefficients[3, 5] = 30.0
    read = read_scene(stored(content))
    place = importance_order(content.motion_file()).tolist().index(3)
    assert read.splats.colors.dense()[place, 5] == pytest.approx([30.0] * 3, abs=0.12)


def test_a_scale_of_zero_becomes_the_smallest_of_the_file():
    content = ball(count=200)
    content.splats.scales[5] = 0.0
    read = read_scene(stored(content))
    place = importance_order(content.motion_file()).tolist().index(5)
    assert (read.splats.scales[place] < 1e-7).all()


def test_a_value_that_is_not_finite_is_named():
    content = ball(count=20)
    content.splats.means[3, 1] = torch.nan
    with pytest.raises(ValueError, match="means: row 3"):
        stored(content.motion_file())


def test_a_motion_that_is_not_finite_is_named():
    content = moving_ball(count=20)
    content.motion.path[5, 1, 2] = torch.nan
    with pytest.raises(ValueError, match="motion: row 5 "):
        stored(content)


def test_one_splat_is_a_scene():
    content = ball(count=1, degree=0)
    assert len(read_scene(stored(content)).splats) == 1


def test_the_formulas_of_the_tests_are_those_of_motion():
    content = moving_ball(count=4)
    first = at_time(content, float(content.motion.center[0]))
    assert torch.equal(first.means[0], content.content.splats.means[0])
    assert isinstance(first.colors, Sh)
    still = at_time(MotionFile(content.content, Motion.none(4)), 0.7)
    assert torch.equal(still.opacities, content.content.splats.opacities)
