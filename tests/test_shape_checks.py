"""Calls that tests make into gsfw are checked: shapes, types, what goes in and what comes out."""

from dataclasses import dataclass

import jaxtyping
import pytest
import torch
from jaxtyping import Float, TypeCheckError, jaxtyped
from shape_checks import CHECKED_CALLS, checked
from torch import Tensor

from gsfw.core.maths.rotations import rotation_matrices


@jaxtyped(typechecker=checked)
def doubled(
    rows: Float[Tensor, "n 3"], out: Tensor, times: int = 2
) -> tuple[Float[Tensor, " n"], int]:
    """Gives back what the test says; its own arguments are sound or not."""
    return out, times


def test_sound_calls_pass():
    assert doubled(torch.zeros(4, 3), torch.zeros(4))[1] == 2


@pytest.mark.parametrize(
    ("rows", "times"),
    [(torch.zeros(4, 2), 2), (torch.zeros(4), 2), (torch.zeros(4, 3).long(), 2),
     ([[0.0, 0.0, 0.0]], 2), (torch.zeros(4, 3), "2")],
    ids=["width", "dimensions", "dtype", "list", "type"],
)  # fmt: skip
def test_an_argument_that_is_not_as_annotated_is_an_error(rows, times):
    with pytest.raises(TypeCheckError, match="checking the parameters of"):
        doubled(rows, torch.zeros(4), times)


@pytest.mark.parametrize("out", [torch.zeros(4, 1), torch.zeros(5), torch.zeros(4).long()])
def test_a_result_that_does_not_fit_the_arguments_is_an_error(out):
    with pytest.raises(TypeCheckError, match="checking the return value of"):
        doubled(torch.zeros(4, 3), out)


def test_functions_of_gsfw_are_checked():
    with pytest.raises(TypeCheckError):
        rotation_matrices(torch.zeros(4, 3))


def test_a_function_is_checked_in_its_first_calls_and_others_all_the_same():
    for _ in range(CHECKED_CALLS):
        with pytest.raises(TypeCheckError):
            doubled(torch.zeros(4), torch.zeros(4))
    doubled(torch.zeros(4), torch.zeros(4))
    with pytest.raises(TypeCheckError):
        rotation_matrices(torch.zeros(4, 3))


@jaxtyped(typechecker=checked)
@dataclass
class Rows:
    """Fields of the same names as those of Quads."""

    rows: Float[Tensor, "n 3"]


@jaxtyped(typechecker=checked)
@dataclass
class Quads:
    """Its generated code equals that of Rows."""

    rows: Float[Tensor, "n 4"]


def test_each_dataclass_is_checked_in_its_own_first_calls():
    for _ in range(CHECKED_CALLS):
        Rows(torch.zeros(5, 3))
    with pytest.raises(TypeCheckError):
        Quads(torch.zeros(5, 3))


def test_the_next_test_is_checked():
    with pytest.raises(TypeCheckError):
        doubled(torch.zeros(4), torch.zeros(4))


def outer(rows: Tensor) -> Tensor:
    """Defines a function as the hook writes it."""

    @jaxtyping.jaxtyped(typechecker=checked)
    def inner(rows: Float[Tensor, "n 3"]) -> Tensor:
        return rows

    return inner(rows)


def test_functions_within_functions_are_checked_in_their_first_calls_too():
    for _ in range(CHECKED_CALLS):
        with pytest.raises(TypeCheckError):
            outer(torch.zeros(4))
    outer(torch.zeros(4))


@pytest.mark.unchecked
def test_nothing_is_checked_in_whole_runs():
    assert torch.equal(outer(torch.zeros(4)), torch.zeros(4))
