"""The plot of requirements: its rows, its curve and the image."""

from dataclasses import replace

import pytest
import torch

from gsfw.charts.style import BLUES
from gsfw.core.loop.requirements import FloatGroup, LeastUseful, Motion, Requirements
from gsfw.studies.requirements.plot import census, plot

REQUIREMENTS = Requirements(
    headline="", step=10, num_gaussians=100,
    groups=(
        FloatGroup("positions", 300, None, ""),
        FloatGroup("SH band 0", 300, None, ""),
        FloatGroup("SH band 1", 900, -0.1, ""),
    ),
    sh_floats=1200, sh_floats_full=1200, rows_by_degree=(0, 100), training_floats={},
    views=("a",), split="eval", protocol="", psnr=30.0,
)  # fmt: skip


def test_rows_are_the_groups_with_floats_shares_and_worth():
    positions, constant, first = census(REQUIREMENTS).rows
    assert (positions.name, positions.count, positions.note) == (
        *("positions", 300, "300 floats, 20 %"),
    )
    assert positions.worth is None
    assert (constant.color, first.color) == BLUES[:2]
    assert (first.worth, first.worth_note) == (-0.1, "-0.10 dB")
    assert "1.5k floats in 100 Gaussians; PSNR 30.00 dB on 1 held-out" in census(REQUIREMENTS).title


def test_every_thing_to_say_makes_the_image_taller():
    heights = [
        len(plot(replace(REQUIREMENTS, **more)))
        for more in (
            {"rows_by_degree": ()},
            {},
            {"motion": Motion(2.0, 0.5)},
            {"motion": Motion(2.0, 0.5), "least_useful": (LeastUseful(0.1, 0.01, 0.0),)},
        )
    ]
    assert heights == sorted(set(heights))


@pytest.mark.slow
def test_what_time_is_worth_is_shown_once():
    motion = Motion(2.0, 0.5)
    with_row = plot(replace(REQUIREMENTS, motion=motion))
    groups = (*REQUIREMENTS.groups, FloatGroup("time parameters", 200, 2.0, ""))
    assert len(plot(replace(REQUIREMENTS, motion=motion, groups=groups))) == len(with_row)


def test_a_curve_of_growth_is_drawn_where_the_strategy_reports_one():
    points = [{"step": step, "num_gaussians": 10 * step} for step in (0, 100, 200)]
    before, after = plot(REQUIREMENTS), plot(replace(REQUIREMENTS, strategy={"curve": points}))
    assert len(after) > len(before)
    assert not torch.equal(after[len(before) :], torch.full_like(after[len(before) :], 255))


def test_points_without_a_count_are_no_curve():
    points = [{"step": 1}, {"step": 2, "num_gaussians": 7}]
    assert census(replace(REQUIREMENTS, strategy={"curve": points})).curve == [(2.0, 7.0)]


def test_a_model_of_which_nothing_was_measured_is_drawn_too():
    bare = replace(REQUIREMENTS, groups=(FloatGroup("points", 0, None, ""),), rows_by_degree=())
    image = plot(bare)
    assert image.shape[1:] == plot(REQUIREMENTS).shape[1:]
    assert image.dtype == torch.uint8
