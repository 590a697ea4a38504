"""Both forms of 4D rotations: rotations they are, and those of the papers."""

import itertools

import pytest
import torch

from gsfw.core.maths.rotations import rotation_matrices
from gsfw.core.maths.slices import normalised
from gsfw.methods.rotor4d.rotation import Rotation
from gsfw.methods.rotor4d.rotor import Rotor
from gsfw.methods.rotor4d.two_quaternions import TwoQuaternions

FORMS = pytest.mark.parametrize("form", [Rotor(), TwoQuaternions()], ids=["rotor", "quaternions"])
X, Y, Z, T = 1, 2, 4, 8
"""Basis vectors as bits; a blade of several has all of theirs."""


def random_numbers(n: int, dtype=torch.float64, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    first, second = torch.randn(2, n, 4, generator=generator, dtype=torch.float64).to(dtype)
    return first, second


def product(first: dict[int, float], second: dict[int, float]) -> dict[int, float]:
    """The geometric product of multivectors whose basis vectors all square to 1."""
    total: dict[int, float] = {}
    for (a, x), (b, y) in itertools.product(first.items(), second.items()):
        swaps = sum((a >> bit).bit_count() for bit in range(1, 5) if b >> (bit - 1) & 1)
        total[a ^ b] = total.get(a ^ b, 0.0) + (-x * y if swaps % 2 else x * y)
    return total


def multivector(first: torch.Tensor, second: torch.Tensor) -> dict[int, float]:
    """The rotor of one row."""
    (s, x, y, z), (p, xt, yt, zt) = first.tolist(), second.tolist()
    bivectors = {X | Y: -z, X | Z: y, Y | Z: -x, X | T: xt, Y | T: yt, Z | T: zt}
    return {0: s, **bivectors, X | Y | Z | T: p}


def reverse(rotor: dict[int, float]) -> dict[int, float]:
    return {blade: -x if blade.bit_count() == 2 else x for blade, x in rotor.items()}


@FORMS
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_matrices_are_rotations_before_and_after_projection(form: Rotation, scale: float):
    first, second = (scale * numbers for numbers in random_numbers(200))
    before = form.matrices(first, second)
    form.project_(first, second)
    after = form.matrices(first, second)
    for matrices in (before, after):
        by_row = matrices.permute(2, 0, 1)
        eye = torch.eye(4, dtype=torch.float64).expand(200, 4, 4)
        torch.testing.assert_close(by_row @ by_row.transpose(1, 2), eye, rtol=0, atol=1e-12)
        torch.testing.assert_close(by_row.det(), torch.ones(200).double(), rtol=0, atol=1e-12)
    torch.testing.assert_close(before, after, rtol=0, atol=1e-12)
    torch.testing.assert_close(form.time_rows(first, second), after[3], rtol=0, atol=1e-14)
    for side in form.sides(first, second):
        torch.testing.assert_close(side.norm(dim=1), torch.ones(200).double(), rtol=0, atol=1e-12)


@FORMS
def test_numbers_and_sides_are_inverse(form: Rotation):
    numbers = random_numbers(20)
    for given, found in zip(numbers, form.numbers(*form.sides(*numbers)), strict=True):
        torch.testing.assert_close(found, given)


@FORMS
def test_a_rotation_of_space_leaves_time_as_it_is(form: Rotation):
    quats, _ = random_numbers(50)
    matrices = form.matrices(*form.of_space(3.0 * quats))
    expected = torch.zeros(4, 4, 50, dtype=torch.float64)
    expected[:3, :3] = rotation_matrices(quats).permute(1, 2, 0)
    expected[3, 3] = 1.0
    torch.testing.assert_close(matrices, expected)


def test_a_rotor_turns_vectors_by_the_sandwich_product():
    first, second = random_numbers(10)
    Rotor().project_(first, second)
    matrices = Rotor().matrices(first, second)
    for row in range(10):
        rotor = multivector(first[row], second[row])
        for column, axis in enumerate((X, Y, Z, T)):
            turned = product(product(rotor, {axis: 1.0}), reverse(rotor))
            found = torch.tensor([turned[each] for each in (X, Y, Z, T)], dtype=torch.float64)
            torch.testing.assert_close(found, matrices[:, column, row])


def test_projection_is_that_of_the_paper():
    first, second = random_numbers(100)
    (s, yz, xz, xy), (p, xt, yt, zt) = (first * torch.tensor([1, -1, 1, -1])).T, second.T
    square = (first.square() + second.square()).sum(1)
    eps = p * s - xy * zt + xz * yt - xt * yz
    d = ((square**2 - 4 * eps**2).sqrt() - square) / (2 * eps)
    rotor = torch.stack(
        [s + d * p, xy - d * zt, xz + d * yt, yz - d * xt, xt - d * yz, yt + d * xz, zt - d * xy,
         p + d * s], dim=1,
    )  # fmt: skip
    s, xy, xz, yz, xt, yt, zt, p = (rotor / rotor.norm(dim=1, keepdim=True)).T
    Rotor().project_(first, second)
    torch.testing.assert_close(first, torch.stack([s, -yz, xz, -xy], dim=1))
    torch.testing.assert_close(second, torch.stack([p, xt, yt, zt], dim=1))


def test_two_quaternions_have_the_matrix_of_the_paper():
    left, right = map(normalised, random_numbers(10))
    for row in range(10):
        (a, b, c, d), (p, q, r, s) = left[row].tolist(), right[row].tolist()
        first = torch.tensor([[a, -b, -c, -d], [b, a, -d, c], [c, d, a, -b], [d, -c, b, a]])
        second = torch.tensor([[p, q, r, s], [-q, p, -s, r], [-r, s, p, -q], [-s, -r, q, p]])
        expected = (first.double() @ second.double()).roll((-1, -1), (0, 1))
        found = TwoQuaternions().matrices(left, right)[:, :, row]
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-6)


@FORMS
def test_gradients_are_finite_and_right_where_constraints_hold_and_where_numbers_vanish(form):
    numbers = random_numbers(6)
    form.project_(*numbers)  # A rotor's eps is zero now.
    numbers[0][0], numbers[1][0] = form.of_space(torch.zeros(1, 4, dtype=torch.float64))
    leaves = tuple(each.requires_grad_() for each in numbers)
    assert torch.autograd.gradcheck(form.matrices, leaves)

    nothing = tuple(torch.zeros(2, 4, requires_grad=True) for _ in range(2))
    matrices = form.matrices(*nothing)
    assert torch.equal(matrices.detach(), torch.eye(4)[:, :, None].expand(4, 4, 2))
    matrices.sum().backward()
    assert not any(bool(each.grad.any()) for each in nothing)
    with torch.no_grad():
        form.project_(*nothing)
    assert torch.equal(form.matrices(*nothing), matrices)


@pytest.mark.parametrize("norm", [1e-11, 1e-6, 1e6, 1e20])
def test_quaternions_of_any_norm_are_normalised_in_float32(norm: float):
    quats, _ = random_numbers(50)
    unit = quats / quats.norm(dim=1, keepdim=True)
    torch.testing.assert_close(normalised((norm * unit).float()), unit.float())
