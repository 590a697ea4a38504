"""Trajectory: how times are kept, and what is between them."""

import pytest
import torch
from support.moving_splats import at
from support.tracked_splats import after, tracked

from gsfw.methods.dynamic3d.trajectory import Pose, Trajectory

FEW = (0.0, 0.25, 1.0)


def pose(n: int = 5, seed: int = 0, colors: bool = True) -> Pose:
    generator = torch.Generator().manual_seed(seed)
    drawn = torch.randn(n, 3 + 4 + 3, generator=generator)
    means, quats, rest = drawn.split([3, 4, 3], dim=1)
    return Pose(means, quats / quats.norm(dim=1, keepdim=True), rest[:, None] if colors else None)


def trajectory(colors: bool = True) -> Trajectory:
    """Two finished times and a third."""
    made = Trajectory(pose(colors=colors))
    for index, time in enumerate(FEW):
        if index:
            made.store(pose(seed=index - 1, colors=colors))
        made.begin(time)
    return made


@pytest.mark.parametrize(("colors", "expected"), [(True, 26), (False, 20)])
def test_a_row_takes_half_the_bytes_of_the_released_code_at_a_time(colors, expected):
    made = trajectory(colors)
    assert made.num_finished == 2
    assert made.num_bytes() == expected * 2 * 5


def test_a_finished_time_comes_back_as_it_was():
    found = trajectory().stored(1, torch.zeros(0))
    expected = pose(seed=1)
    assert torch.equal(found.means, expected.means)
    torch.testing.assert_close(found.quats, expected.quats, atol=3e-5, rtol=0)
    torch.testing.assert_close(found.colors, expected.colors, atol=1e-3, rtol=1e-3)


def test_at_a_captured_time_the_pose_is_that_of_the_time():
    made, current = trajectory(), pose(seed=2)
    for index, time in enumerate(FEW[:2]):
        found, expected = made.at(at(time), current), made.stored(index, current.means)
        assert torch.equal(found.means, expected.means)
        assert float((found.quats * expected.quats).sum(1).abs().min()) > 1 - 1e-6
    for time in (1.0, 2.0):
        found = made.at(at(time), current)
        assert torch.equal(found.means, current.means)
        assert torch.equal(found.quats, current.quats)
        assert torch.equal(found.colors, current.colors)
    early = made.at(at(-1.0), current)
    assert torch.equal(early.means, made.stored(0, current.means).means)


def test_between_two_times_it_is_between_their_poses():
    made, current = trajectory(), pose(seed=2)
    found = made.at(at(0.25 + 0.75 / 3), current)
    before = made.stored(1, current.means)
    torch.testing.assert_close(found.means, (2 * before.means + current.means) / 3)
    torch.testing.assert_close(found.colors, (2 * before.colors + current.colors) / 3)
    # The rotation lies on the shorter way: as near to both as they are to one another, or nearer.
    turned = torch.nn.functional.normalize(found.quats, dim=1)
    between = (before.quats * current.quats).sum(1).abs()
    for end in (before.quats, current.quats):
        assert bool(((turned * end).sum(1).abs() >= between - 1e-6).all())


def test_one_time_alone_is_the_same_always():
    made, current = Trajectory(pose()), pose(seed=1)
    assert made.at(at(0.3), current) is current
    made.begin(0.0)
    assert made.at(at(0.3), current) is current
    assert made.num_finished == 0


def test_a_time_that_a_float32_rounds_is_that_time():
    made = Trajectory(pose())
    third = float(torch.tensor(1 / 3, dtype=torch.float32))
    for time in (0.0, third, 1.0):
        if made.current is not None:
            made.store(pose(seed=int(3 * made.current)))
        made.begin(time)
    found = made.at(torch.tensor(1 / 3, dtype=torch.float32), pose(seed=5))
    assert torch.equal(found.means, made.stored(1, found.means).means)


def test_a_state_of_more_times_and_rows_is_taken_over():
    made = after(FEW, n=9)
    fresh = tracked(n=4)
    fresh.load_state_dict(made.state_dict())
    assert fresh.trajectory.current == 1.0
    assert fresh.trajectory.num_finished == 2
    for time in (0.0, 0.1, 0.25, 0.8, 1.0):
        first, second = made.splats(at(time)), fresh.splats(at(time))
        for name, tensor in first.tensors().items():
            assert torch.equal(tensor, second.tensors()[name]), name
    assert all(isinstance(value, torch.Tensor) for value in made.state_dict().values())
