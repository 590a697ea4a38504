"""Rigidity: the equations, what they are zero for, and their gradients in float64."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from gsfw.core.maths.rotations import relative_quaternions, unit_matrices
from gsfw.core.operators import Operators
from gsfw.methods.dynamic3d.rigidity import Neighbors, rigidity


def drawn(*shape: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def neighbors_of(points: torch.Tensor, k: int = 4) -> Neighbors:
    rows = Operators().neighbors(points, k)
    offsets = points[rows] - points[:, None]
    weights = 0.2 + 0.7 * drawn(len(points), k, seed=7).sigmoid()
    return Neighbors(rows, weights, offsets, offsets.norm(dim=2))


def multiplied(first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
    """first * second, row by row."""
    conjugate = second * torch.tensor([1.0, -1, -1, -1], dtype=second.dtype)
    return relative_quaternions(first, conjugate)


def test_a_rigid_motion_costs_nothing():
    points, quats = drawn(30, 3), normalize(drawn(30, 4, seed=1), dim=1)
    turn = normalize(drawn(1, 4, seed=2), dim=1)
    moved = points @ unit_matrices(turn)[0].T + torch.tensor([0.3, -1.0, 2.0], dtype=torch.float64)
    turned = multiplied(turn.expand(30, 4), quats)
    for signs in (1.0, -1.0):
        terms = rigidity(neighbors_of(points), moved, signs * 2.5 * turned, quats)
        assert [float(term) for term in terms] == pytest.approx([0, 0, 0], abs=1e-7)


def test_each_term_is_what_its_equation_says():
    points, quats = drawn(12, 3), normalize(drawn(12, 4, seed=1), dim=1)
    means, now = points + 0.1 * drawn(12, 3, seed=3), quats + 0.1 * drawn(12, 4, seed=4)
    known = neighbors_of(points)
    turns = relative_quaternions(normalize(now, dim=1), quats)
    sums = [0.0, 0.0, 0.0]
    for i in range(12):
        rotation = unit_matrices(turns[i : i + 1])[0]
        for place, j in enumerate(known.rows[i].tolist()):
            weight = float(known.weights[i, place])
            apart, before = means[j] - means[i], points[j] - points[i]
            # As the paper has it, with the transpose on what is now.
            sums[0] += math.sqrt(weight) * float((before - rotation.T @ apart).norm())
            sums[1] += math.sqrt(weight) * float((turns[j] - turns[i]).norm())
            sums[2] += math.sqrt(weight) * abs(float(apart.norm() - before.norm()))
    found = rigidity(known, means, now, quats)
    expected = [total / known.rows.numel() for total in sums]
    assert [float(term) for term in found] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("term", [0, 1, 2])
def test_gradients_agree_with_difference_quotients(term):
    points, quats = drawn(8, 3), normalize(drawn(8, 4, seed=1), dim=1)
    known = neighbors_of(points)
    means = (points + 0.1 * drawn(8, 3, seed=3)).requires_grad_()
    now = (1.7 * quats + 0.1 * drawn(8, 4, seed=4)).requires_grad_()
    assert torch.autograd.gradcheck(
        lambda means, now: rigidity(known, means, now, quats)[term], (means, now), atol=1e-7
    )


def test_where_nothing_has_moved_gradients_are_finite():
    points, quats = drawn(8, 3), normalize(drawn(8, 4, seed=1), dim=1)
    points[1] = points[0]
    means, now = points.clone().requires_grad_(), quats.clone().requires_grad_()
    torch.stack(rigidity(neighbors_of(points), means, now, quats)).sum().backward()
    assert means.grad is not None
    assert now.grad is not None
    assert bool(means.grad.isfinite().all())
    assert bool(now.grad.isfinite().all())
