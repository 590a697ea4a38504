"""Quaternions, matrices and rotation vectors are converted into one another."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from gsfw.core.maths.rotations import (
    from_integers,
    matrices_rows_last,
    multiply_quaternions,
    quaternions_of,
    relative_quaternions,
    rotation_matrices,
    rotation_vector_matrices,
    same_half,
    to_integers,
    unit_matrices,
)


def random_quats(n: int = 200, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(n, 4, generator=generator, dtype=torch.float64)


def rotation(seed: int) -> torch.Tensor:
    """A random rotation."""
    generator = torch.Generator().manual_seed(seed)
    matrix, _ = torch.linalg.qr(torch.randn(3, 3, generator=generator, dtype=torch.float64))
    return matrix * matrix.det()


def matrix_of(quat: torch.Tensor) -> torch.Tensor:
    """The textbook rotation matrix of a unit quaternion, wxyz."""
    w, x, y, z = quat.tolist()
    return torch.tensor(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ],
        dtype=torch.float64,
    )


def test_a_turn_about_z_has_the_matrix_it_should_have():
    half = math.radians(15)
    quats = torch.tensor([[math.cos(half), 0, 0, math.sin(half)]], dtype=torch.float64)
    c, s = math.cos(2 * half), math.sin(2 * half)
    expected = torch.tensor([[[c, -s, 0], [s, c, 0], [0, 0, 1]]], dtype=torch.float64)
    torch.testing.assert_close(unit_matrices(quats), expected)


def test_a_relative_rotation_leads_from_the_second_to_the_first():
    first, second = normalize(random_quats(), dim=1), normalize(random_quats(seed=1), dim=1)
    turned = unit_matrices(relative_quaternions(first, second))
    torch.testing.assert_close(turned @ unit_matrices(second), unit_matrices(first))
    identity = relative_quaternions(first, first)
    torch.testing.assert_close(identity, torch.eye(1, 4, dtype=torch.float64).expand(200, 4))


def test_eight_bytes_keep_a_rotation_to_a_hundredth_of_a_degree():
    quats = 3 * random_quats(5000)
    stored = to_integers(quats)
    assert stored.element_size() * stored.shape[1] == 8
    found = from_integers(stored, quats)
    torch.testing.assert_close(found.norm(dim=1), torch.ones(5000, dtype=torch.float64))
    cosines = (normalize(quats, dim=1) * found).sum(1).clamp(max=1)
    assert math.degrees(2 * float(cosines.min().acos())) < 0.006
    again = to_integers(found).int() - stored.int()
    assert int(again.abs().max()) <= 1


def test_the_nearer_of_two_signs_is_taken():
    quats = random_quats()
    near = quats + 0.01
    torch.testing.assert_close(same_half(-quats, near), quats)
    torch.testing.assert_close(same_half(quats, near), quats)


@pytest.mark.parametrize("seed", range(8))
def test_quaternions_and_rotation_matrices_agree(seed):
    quat = quaternions_of(rotation(seed))
    assert float(quat.norm()) == pytest.approx(1)
    assert float(quat[0]) >= 0
    assert torch.allclose(matrix_of(quat), rotation(seed))


def test_many_rotation_matrices_have_the_quaternions_of_each():
    matrices = torch.stack([rotation(seed) for seed in range(8)])
    expected = torch.stack([quaternions_of(matrix) for matrix in matrices])
    torch.testing.assert_close(quaternions_of(matrices), expected, rtol=0, atol=1e-14)
    assert quaternions_of(matrices[:0]).shape == (0, 4)


def test_half_turns_have_a_quaternion_too():
    for axis in range(3):
        half = -torch.eye(3, dtype=torch.float64)
        half[axis, axis] = 1
        assert torch.allclose(matrix_of(quaternions_of(half)), half)


def test_a_product_of_quaternions_turns_by_the_second_first():
    first, second = rotation(1), rotation(2)
    product = multiply_quaternions(quaternions_of(first), quaternions_of(second))
    assert torch.allclose(matrix_of(product), first @ second)


def test_quaternions_of_any_norm_have_one_matrix_in_every_form():
    quats = random_quats()
    expected = torch.stack([matrix_of(quat) for quat in normalize(quats, dim=1)])
    torch.testing.assert_close(unit_matrices(normalize(quats, dim=1)), expected)
    torch.testing.assert_close(matrices_rows_last(7 * quats), expected.permute(1, 2, 0))
    for scale in (1e-9, 1.0, 1e20):
        torch.testing.assert_close(rotation_matrices(scale * quats), expected)


def test_rotation_vectors_give_the_exponential_of_their_cross_products():
    vectors = torch.randn(50, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    vectors = torch.cat([vectors, 1e-6 * vectors, torch.zeros(1, 3, dtype=torch.float64)])
    x, y, z = vectors.T
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=1).view(-1, 3, 3)
    found = rotation_vector_matrices(vectors)
    torch.testing.assert_close(found, torch.linalg.matrix_exp(cross), rtol=0, atol=1e-12)
