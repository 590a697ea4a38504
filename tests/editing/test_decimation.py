"""Decimation and refitting: exact numbers, a bounded loss, and colours that are found again."""

from dataclasses import replace

import pytest
import torch
from support.editing import WORLD, edited, piece_of
from support.scenes import random_splats

from gsfw.core.errors import ConfigError
from gsfw.core.maths.frame import transform_splats
from gsfw.core.splats import Sh, Splats
from gsfw.editing.decimation import decimate
from gsfw.editing.refit import Comparison, refitted

# What is checked are renders, many of them; shapes are those of other tests.
pytestmark = pytest.mark.unchecked


def world_splats(count=150):
    return transform_splats(random_splats(count, 1, dtype=torch.float64), WORLD)


def every_one_twice():
    """Splats of half the opacity, each twice: half of them suffice."""
    splats = world_splats(60)
    thin = replace(splats, opacities=1 - (1 - splats.opacities.clamp_max(0.9)).sqrt())
    return Splats.cat([thin, thin])


def test_decimation_is_exact_in_number_and_its_loss_is_bounded():
    found = decimate(piece_of(every_one_twice()), 60)
    assert len(found.piece) == 60
    assert found.psnr > 34
    assert found.psnr >= found.before_refit


@pytest.mark.slow
def test_colours_are_refitted_in_a_world_that_is_not_the_scene_frame():
    found = decimate(piece_of(world_splats()), 60)
    assert len(found.piece) == 60
    assert found.psnr > found.before_refit + 0.5


@pytest.mark.slow
def test_colours_that_were_changed_are_found_again():
    piece = piece_of(world_splats(30))
    splats, comparison = piece.scene_splats(), Comparison.of(piece.capture())
    dense = splats.colors.dense().clone()
    dense[:, 0] = dense[:, 0].clamp_min(0.0)  # Nothing is clamped in renders.
    dense[:, 1:] *= 0.1
    splats = replace(splats, colors=Sh(dense, 1))
    targets = comparison.images(splats)
    grey = replace(splats, colors=Sh(torch.cat([dense[:, :1] * 0 + 0.5, dense[:, 1:]], 1), 1))
    found = refitted(grey, comparison, targets, piece.contributions().total, steps=30)
    assert comparison.psnr(grey, targets) + 15 < comparison.psnr(found, targets)


def test_a_number_that_is_not_reached_changes_nothing():
    piece = piece_of(world_splats(20))
    result = edited(piece, "decimate.count", "20")
    assert result.piece is piece
    assert result.note == "there are no more"


@pytest.mark.slow
@pytest.mark.parametrize("megabytes", ["0.00501", "0.005"])
def test_decimation_to_a_size_fills_it_and_not_more(megabytes):
    left = len(edited(piece_of(world_splats()), "decimate.mb", megabytes).piece)
    budget = float(megabytes) * 1e6
    assert 100 * left + 40 <= budget < 100 * (left + 1) + 40


@pytest.mark.slow
def test_a_size_that_no_file_has_is_refused():
    with pytest.raises(ConfigError, match="a file with 1 of the Gaussians still has 140 bytes"):
        edited(piece_of(world_splats(20)), "decimate.mb", "0.0001")
