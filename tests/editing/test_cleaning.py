"""Cleaning and floaters: what was planted is found, and nothing else."""

import math
from dataclasses import replace

import torch
from support.scenes import random_splats

from gsfw.core.exchange import SplatFile
from gsfw.editing import cleaning
from gsfw.editing.floaters import floating
from gsfw.formats.visible_splats import without_invisible


def sound_splats(count=200):
    splats = random_splats(count, 1, dtype=torch.float64)
    return replace(splats, opacities=splats.opacities.clamp_min(0.1))


def test_sound_splats_have_no_fault():
    for fault in cleaning.FAULTS.values():
        assert not fault(sound_splats()).any()


def test_every_planted_fault_is_found_alone():
    splats = sound_splats()
    size = cleaning.scene_size(splats)
    means, opacities, scales = splats.means.clone(), splats.opacities.clone(), splats.scales.clone()
    quats = splats.quats.clone()
    means[3, 1] = torch.nan
    opacities[5] = 0.9 / 255
    scales[7] = torch.tensor([0.1, 0.0, 0.0])
    quats[8] = 0.0
    scales[9] = torch.tensor([size, size / 100, size / 100])
    scales[10] = torch.tensor([size, size, size / 1000])  # A sheet, not a needle.
    planted = replace(splats, means=means, opacities=opacities, scales=scales, quats=quats)
    found = {name: f(planted).nonzero()[:, 0].tolist() for name, f in cleaning.FAULTS.items()}
    assert found == {"not_finite": [3], "invisible": [5], "degenerate": [7, 8], "needles": [9]}


def test_values_beyond_float32_are_not_finite():
    splats = random_splats(6, 1, dtype=torch.float64)
    means, scales = splats.means.clone(), splats.scales.clone()
    means[1, 2] = 1e39
    scales[2, 0], scales[3, 0], scales[4, 0] = 1e39, math.exp(88.5), math.exp(87.5)
    wild = replace(splats, means=means, scales=scales)
    assert cleaning.not_finite(wild).nonzero()[:, 0].tolist() == [1, 2, 3]


def test_the_faintest_opacity_of_eight_bits_counts_as_visible_everywhere():
    splats = random_splats(3, 0, dtype=torch.float64)
    opacities = torch.tensor([1 / 255 * (1 - 5e-7), 1 / 255 * (1 - 2e-6), 0.5], dtype=torch.float64)
    faint = replace(splats, opacities=opacities)
    assert cleaning.invisible(faint).tolist() == [False, True, False]
    assert without_invisible(SplatFile(faint))[1] == 1


def test_planted_floaters_are_found_and_the_rest_stays():
    generator = torch.Generator().manual_seed(1)
    near = torch.randn(2000, 3, generator=generator, dtype=torch.float64)
    surface = near / near.norm(dim=1, keepdim=True)
    far = torch.tensor([[3.0, 0, 0], [0, 4, 0], [0, 0, 0]], dtype=torch.float64)
    found = floating(torch.cat([surface, far]), 4.0)
    assert found.nonzero()[:, 0].tolist() == [2000, 2001, 2002]


def test_a_regular_grid_and_few_points_have_no_floaters():
    axis = torch.arange(8, dtype=torch.float64)
    assert not floating(torch.cartesian_prod(axis, axis, axis), 8.0).any()
    assert not floating(torch.zeros(5, 3), 4.0).any()
    assert not floating(torch.zeros(1, 3), 4.0).any()
