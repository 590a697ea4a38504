"""Tensors of temporal fields, and their results in kernels and in plain torch."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from gsfw.core.operators import Operators

Function = Callable[[Operators, list[Tensor]], Sequence[Tensor]]
"""Outputs of operators for some tensors."""


def numbers(*shape: int, seed: int, dtype: torch.dtype = torch.float64) -> Tensor:
    """Random numbers in [0, 1)."""
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(shape, generator=generator, dtype=torch.float64).to(dtype)


def plane_tensors(places: Tensor, channels: int, sides: Sequence[int] = (7, 12)) -> list[Tensor]:
    """Places, planes of each resolution, and lines of each resolution."""
    dtype = places.dtype
    return [
        places,
        *(numbers(3, s, s, channels, seed=s, dtype=dtype) + 0.5 for s in sides),
        *(numbers(3, s, channels, seed=s + 1, dtype=dtype) + 0.5 for s in sides),
    ]


def product(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor, ...]:
    """The products of such planes."""
    places, *tables = tensors
    half = len(tables) // 2
    return (operators.plane_product(places, tables[:half], tables[half:], 1.7),)


HASH_SIZES, HASH_ROWS = ((5, 3), (9, 4), (40, 7)), (375, 4096, 1024)
"""Resolutions in space and time, and rows: the last table has fewer than corners, and a hash."""


def hash_tables(dtype: torch.dtype, channels: int) -> list[Tensor]:
    """Tables of such resolutions."""
    return [numbers(rows, channels, seed=i, dtype=dtype) for i, rows in enumerate(HASH_ROWS)]


def hashed(places: Tensor, time: float = 0.3, sizes: Sequence = HASH_SIZES) -> Function:
    """Features as a function of the tables."""

    def features(operators: Operators, tables: list[Tensor]) -> tuple[Tensor]:
        at = places.to(tables[0])
        when = torch.tensor(time, dtype=torch.float64, device=at.device)
        return (operators.hash_features(at, when, tables, sizes),)

    return features


def quaternions_and_scales(
    rows: int, dtype: torch.dtype, low: float = -3.0, high: float = 0.0
) -> list[Tensor]:
    """Left and right quaternions, and logarithms of scales, of Gaussians of space and time."""
    left, right = (numbers(rows, 4, seed=i, dtype=dtype) - 0.5 for i in (1, 2))
    return [left, right, low + (high - low) * numbers(rows, 4, seed=3, dtype=dtype)]


def sliced(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor, ...]:
    """The slices of such Gaussians."""
    return tuple(operators.slices(*tensors[:2], tensors[2].exp()))


def variation(axes: tuple[int, ...], order: int) -> Function:
    """Squared differences of a grid along some axes."""
    return lambda operators, tensors: (operators.squared_differences(*tensors, axes, order, 0.3),)


def distance(operators: Operators, tensors: list[Tensor]) -> tuple[Tensor]:
    """Mean distance of a grid from a value."""
    return (operators.mean_distance(tensors[0], 0.5, 0.7),)


def gradients(
    function: Function,
    operators: Operators,
    tensors: Sequence[Tensor],
    place: torch.device,
    silent: int = 3,
) -> list[Tensor]:
    """Outputs and all gradients, brought back from ``place``.

    Every ``silent``-th row of the outputs has an incoming gradient of zero.
    """
    leaves = [tensor.detach().clone().to(place).requires_grad_() for tensor in tensors]
    outputs = function(operators, leaves)
    flows = []
    for index, output in enumerate(outputs):
        flow = numbers(*output.shape, seed=20 + index, dtype=output.dtype)
        if flow.dim() > 0:
            flow[::silent] = 0
        flows.append(flow.to(place))
    # Torch's own value has no gradient where no two cells are compared.
    pairs = [pair for pair in zip(outputs, flows, strict=True) if pair[0].requires_grad]
    if pairs:
        torch.autograd.backward(*zip(*pairs, strict=True))
    moved = [torch.zeros_like(leaf) if leaf.grad is None else leaf.grad for leaf in leaves]
    return [value.detach().cpu() for value in (*outputs, *moved)]


def agree(
    function: Function,
    operators: Operators,
    tensors: Sequence[Tensor],
    place: torch.device,
    roundings: float = 32.0,
) -> None:
    """Require outputs and gradients of plain torch in float64, but for rounding.

    Args:
        function: outputs of operators for some tensors.
        operators: those of kernels.
        tensors: inputs, all of one type.
        place: device that the kernels run on.
        roundings: of the largest number of a tensor, for sums of few terms.
    """
    found = gradients(function, operators, tensors, place)
    exact = [tensor.double() for tensor in tensors]
    expected = gradients(function, Operators(), exact, torch.device("cpu"))
    for value, other in zip(found, expected, strict=True):
        assert value.dtype == tensors[0].dtype
        allowed = roundings * torch.finfo(value.dtype).eps * float(other.abs().max())
        assert float((value.double() - other).abs().max()) <= allowed
