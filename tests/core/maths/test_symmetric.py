"""Eigenvalues and axes of symmetric matrices, against torch's in float64."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from gsfw.core.maths.rotations import quaternions_of, rotation_matrices
from gsfw.core.maths.symmetric import largest_eigenvalues, principal_axes

VALUES = st.sampled_from([0.0, 1.0, 1.0 + 1e-7, 0.5, 3.0, 1e-4, 1e-12, -1.0])


def turned(values: list[float], seed: int, dtype: torch.dtype) -> torch.Tensor:
    """A symmetric matrix with these eigenvalues, up to the rounding of its type."""
    quaternion = torch.randn(1, 4, generator=torch.Generator().manual_seed(seed)).double()
    rotation = rotation_matrices(quaternion)
    matrix = rotation @ torch.diag(torch.tensor(values).double()) @ rotation.mT
    return ((matrix + matrix.mT) / 2).to(dtype)


@settings(max_examples=100)
@given(
    st.lists(VALUES, min_size=3, max_size=3),
    st.integers(0, 2**16),
    st.sampled_from([1e-18, 1.0, 1e12]),
    st.sampled_from([torch.float32, torch.float64]),
)
def test_the_largest_eigenvalue_is_that_of_torch(values, seed, factor, dtype):
    matrix = turned([factor * value for value in values], seed, dtype)
    found = largest_eigenvalues(matrix)
    assert found.dtype == dtype
    expected = torch.linalg.eigvalsh(matrix.double())[:, 2]
    # acos loses half of the digits of float64 where the two largest are equal.
    allowed = max(4 * torch.finfo(dtype).eps, 1e-7) * float(matrix.abs().max())
    assert float((found.double() - expected).abs()) <= allowed


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_zeros_and_no_matrices_have_finite_eigenvalues(dtype):
    assert largest_eigenvalues(torch.zeros(2, 3, 3, dtype=dtype)).tolist() == [0.0, 0.0]
    assert largest_eigenvalues(torch.zeros(0, 3, 3, dtype=dtype)).shape == (0,)


def test_axes_are_rotations_that_give_the_matrix_back():
    matrices = torch.cat([turned([0.1, 2.0, 3.0], seed, torch.float32) for seed in range(8)])
    values, axes = principal_axes(matrices)
    again = axes @ torch.diag_embed(values) @ axes.mT
    torch.testing.assert_close(again, matrices.double(), rtol=1e-6, atol=1e-6)
    torch.testing.assert_close(axes.det(), torch.ones(8).double())
    assert (values.diff(dim=1) >= 0).all()
    assert quaternions_of(axes).isfinite().all()
