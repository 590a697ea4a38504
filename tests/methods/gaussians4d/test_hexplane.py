"""Six planes at several resolutions, against grid_sample, and their regularisers, against loops."""

from dataclasses import replace

import pytest
import torch
from torch.nn.functional import grid_sample

from gsfw.core.operators import Operators
from gsfw.methods.gaussians4d.config import HexPlaneConfig
from gsfw.methods.gaussians4d.hexplane import UNIT, HexPlane

SMALL = HexPlaneConfig(channels=8, resolution=5, multipliers=(1, 2))


def planes(times: int = 4, config: HexPlaneConfig = SMALL) -> HexPlane:
    generator = torch.Generator().manual_seed(0)
    encoder = HexPlane(config, times, Operators(), generator).double()
    with torch.no_grad():
        for plane in encoder.time:
            plane.add_(0.3 * torch.randn(plane.shape, generator=generator, dtype=torch.float64))
    return encoder


def places(n: int = 30) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return 2 * torch.rand(n, 3, generator=generator, dtype=torch.float64) - 1


def read(plane, first, second):
    """A plane [r, s, d] at coordinates in [-1, 1] of its first and second axis."""
    at = torch.stack([second, first], dim=1)[None, :, None]
    return grid_sample(plane.permute(2, 0, 1)[None], at, align_corners=True)[0, :, :, 0].T


@pytest.mark.parametrize("time", [0.0, 0.2, 1 / 3, 0.77, 1.0])
def test_features_are_products_of_six_planes_at_each_resolution(time):
    encoder, points = planes(), places()
    x, y, z = points.T
    t = torch.full_like(x, 2 * time - 1)
    expected = []
    for space, over_time in zip(encoder.space, encoder.time, strict=True):
        factors = [read(space[0], x, y), read(space[1], x, z), read(space[2], y, z)]
        factors += [read(over_time[:, i], t, axis) for i, axis in enumerate((x, y, z))]
        expected.append(UNIT * torch.stack(factors).prod(0))
    found = encoder(points, torch.tensor(time, dtype=torch.float64))
    assert found.shape == (30, encoder.features)
    torch.testing.assert_close(found, torch.cat(expected, dim=1), atol=1e-12, rtol=1e-12)


def test_time_planes_are_used_from_their_first_row_to_their_last():
    encoder, points = planes(times=5), places()
    for row in range(5):
        encoder.zero_grad()
        encoder(points, torch.tensor(row / 4, dtype=torch.float64)).sum().backward()
        for plane in encoder.time:
            used = plane.grad.abs().flatten(1).amax(1) > 1e-12
            assert used.tolist() == [other == row for other in range(5)]


def test_times_outside_are_those_of_the_ends():
    encoder, points = planes(), places()
    for outside, end in ((-3.0, 0.0), (1e8, 1.0)):
        found, expected = (
            encoder(points, torch.tensor(time, dtype=torch.float64)) for time in (outside, end)
        )
        assert torch.equal(found, expected)


def test_features_do_not_depend_on_time_before_training():
    encoder = HexPlane(SMALL, 7, Operators(), torch.Generator().manual_seed(0))
    points = places().float()
    first, other = encoder(points, torch.tensor(0.1)), encoder(points, torch.tensor(0.83))
    torch.testing.assert_close(first, other)
    assert 0.5 < float(first.detach().mean()) < 2
    for plane in encoder.space:
        assert bool(((plane >= 0.1) & (plane <= 0.5)).all())


def test_gradients_are_those_of_finite_differences():
    encoder = planes()
    points, time = places(6).requires_grad_(), torch.tensor(0.4, dtype=torch.float64)
    inputs = (points, *encoder.parameters())
    assert torch.autograd.gradcheck(lambda *_: encoder(points, time), inputs, fast_mode=True)


def test_regularizers_are_those_of_loops_over_planes():
    config = replace(SMALL, plane_tv=2.0, time_smoothness=3.0, time_l1=5.0)
    encoder = planes(config=config)
    variation = smoothness = change = 0.0
    for space, over_time in zip(encoder.space, encoder.time, strict=True):
        side, times = space.shape[1], len(over_time)
        for p in range(3):
            plane, track = space[p].detach(), over_time[:, p].detach()
            for i in range(side - 1):
                count = (side - 1) * side * 8
                variation += float((plane[i + 1] - plane[i]).square().sum()) / count
                variation += float((plane[:, i + 1] - plane[:, i]).square().sum()) / count
            for i in range(1, times - 1):
                bend = track[i - 1] - 2 * track[i] + track[i + 1]
                smoothness += float(bend.square().sum()) / ((times - 2) * side * 8)
            change += float((1 - track).abs().sum()) / track.numel()
    found = {name: value.item() for name, value in encoder.regularizers().items()}
    assert found == pytest.approx(
        {"plane_tv": 2 * variation, "time_smoothness": 3 * smoothness, "time_l1": 5 * change}
    )


def test_regularizers_of_weight_zero_are_left_out_and_two_times_are_smooth():
    config = replace(SMALL, plane_tv=0.0, time_l1=0.0)
    found = planes(times=2, config=config).regularizers()
    assert {name: value.item() for name, value in found.items()} == {"time_smoothness": 0.0}


def test_the_defaults_have_half_the_paper_s_resolution_and_a_smoother_space():
    config = HexPlaneConfig()
    assert (config.plane_tv, config.time_smoothness, config.time_l1) == (1e-2, 1e-2, 1e-4)
    assert (config.channels, config.resolution, config.multipliers) == (32, 32, (1, 2))
    assert (config.width, config.depth) == (64, 1)
