"""Quaternions: relative ones, their matrices, and what 16 bits keep of them."""

import math

import torch
from torch.nn.functional import normalize

from gsfw.methods.dynamic3d.rotation import (
    from_integers,
    matrices,
    relative,
    same_half,
    to_integers,
)


def random_quats(n: int = 200, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(n, 4, generator=generator, dtype=torch.float64)


def test_a_turn_about_z_has_the_matrix_it_should_have():
    half = math.radians(15)
    quats = torch.tensor([[math.cos(half), 0, 0, math.sin(half)]], dtype=torch.float64)
    c, s = math.cos(2 * half), math.sin(2 * half)
    expected = torch.tensor([[[c, -s, 0], [s, c, 0], [0, 0, 1]]], dtype=torch.float64)
    torch.testing.assert_close(matrices(quats), expected)


def test_a_relative_rotation_leads_from_the_second_to_the_first():
    first, second = normalize(random_quats(), dim=1), normalize(random_quats(seed=1), dim=1)
    turned = matrices(relative(first, second))
    torch.testing.assert_close(turned @ matrices(second), matrices(first))
    identity = relative(first, first)
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
