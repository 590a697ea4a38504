"""The picture shows floats in proportion, and has as many lines as there is to say."""

from dataclasses import replace

import pytest
import torch

from gsfw.core.loop.requirements import FloatGroup, LeastUseful, Motion, Requirements
from gsfw.studies.requirements.plot import BAR, BLUES, HEADING, MARGIN, WIDTH, plot

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


def width_of(picture, color):
    """Pixels of a colour along the bar of all floats."""
    line = picture[round(HEADING + BAR / 2)]
    return int((line == torch.tensor(color, dtype=torch.uint8)).all(-1).sum())


def test_the_bar_of_all_floats_has_the_shares_of_the_groups():
    picture = plot(REQUIREMENTS)
    assert picture.shape[1:] == (WIDTH, 3)
    length = WIDTH - 2 * MARGIN
    assert width_of(picture, BLUES[0]) == pytest.approx(0.2 * length, abs=2)
    assert width_of(picture, BLUES[1]) == pytest.approx(0.6 * length, abs=2)


def test_every_thing_to_say_makes_the_picture_taller():
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


def test_a_model_of_which_nothing_was_measured_is_drawn_too():
    bare = replace(REQUIREMENTS, groups=(FloatGroup("points", 0, None, ""),), rows_by_degree=())
    assert plot(bare).shape[1] == WIDTH
