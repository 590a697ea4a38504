"""Temporal fields in native code: planes, hash grids, slices, networks and regularisers.

In the backward pass of planes, hash grids and networks, rows whose incoming gradient is zero (no
pixel shows them) are left out. A graph is for one backward pass: gradients that forward computes
are handed on without a copy, and nothing is differentiated twice.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from gsfw.core.maths.hash_features import PRIMES
from gsfw.core.maths.slices import Slices
from gsfw.core.maths.variation import four_axes
from gsfw.core.operators import Gate, Layer
from gsfw.kernels.cpu.native_module import required
from gsfw.kernels.cpu.threads import num_threads

LANES = 16
"""Numbers of features and widths of layers that kernels take are multiples of it."""
MOST_CORNERS = 2**15
"""More corners than this along an axis of a hash grid are left to torch."""


def plane_product(
    places: Float[Tensor, "n 3"],
    planes: Sequence[Float[Tensor, "3 _ _ d"]],
    lines: Sequence[Float[Tensor, "3 _ d"]],
    scale: float,
) -> Float[Tensor, "n f"]:
    """``Operators.plane_product`` for channels that are a multiple of 16."""
    features: Tensor = _PlaneProduct.apply(places, scale, *planes, *lines)
    return features


def relu_network(
    inputs: Float[Tensor, "n f"],
    layers: Sequence[Layer],
    heads: Sequence[Layer],
    gate: Gate | None,
) -> tuple[Float[Tensor, "n _"], ...]:
    """``Operators.relu_network`` for layers with a multiple of 16 inputs."""
    parameters = [parameter for layer in (*layers, *heads) for parameter in layer]
    outputs: tuple[Tensor, ...] = _ReluNetwork.apply(inputs, len(layers), gate, *parameters)
    return outputs


def hash_features(
    places: Float[Tensor, "n 3"],
    time: float,
    tables: Sequence[Float[Tensor, "_ d"]],
    sizes: Sequence[tuple[int, int]],
) -> Float[Tensor, "n f"]:
    """``Operators.hash_features``."""
    features: Tensor = _HashFeatures.apply(places.detach(), time, tuple(sizes), *tables)
    return features


def slices(
    left: Float[Tensor, "n 4"], right: Float[Tensor, "n 4"], scales: Float[Tensor, "n 4"]
) -> Slices:
    """``Operators.slices``."""
    return Slices(*_Slices.apply(left, right, scales))


def squared_differences(
    grid: Float[Tensor, "*cells"], axes: Sequence[int], order: int, weight: float
) -> Float[Tensor, ""] | None:
    """``Operators.squared_differences``; ``None`` for axes that native code does not take."""
    cells = four_axes(grid.shape, [axis % grid.dim() for axis in axes], order)
    if cells is None:
        return None
    sizes = [grid.numel() * max(n - order, 0) // n for n in cells[1:3]]
    weights = [weight / size if size > 0 else 0.0 for size in sizes]

    def measure(values: Tensor, gradient: Tensor | None) -> float:
        total: float = required().grid_variation(values, order, *weights, gradient, num_threads())
        return total

    found: Tensor = _Penalty.apply(grid.contiguous().view(cells), measure)
    return found


def mean_distance(
    values: Float[Tensor, "*cells"], center: float, weight: float
) -> Float[Tensor, ""]:
    """``Operators.mean_distance``."""
    share = weight / values.numel()

    def measure(flat: Tensor, gradient: Tensor | None) -> float:
        total: float = required().grid_distance(flat, center, share, gradient, num_threads())
        return share * total

    found: Tensor = _Penalty.apply(values.contiguous().view(-1), measure)
    return found


class _Penalty(torch.autograd.Function):
    """A scalar of one tensor; forward computes the gradient too."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        values: Tensor,
        measure: Callable[[Tensor, Tensor | None], float],
    ) -> Tensor:
        gradient = torch.empty_like(values) if ctx.needs_input_grad[0] else None
        ctx.save_for_backward(gradient)
        return values.new_tensor(measure(values.detach(), gradient))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:  # noqa: ANN401
        (own,) = ctx.saved_tensors
        return own if gradient == 1 else own * gradient, None


class _PlaneProduct(torch.autograd.Function):
    """Interpolates six factors and multiplies them; backward interpolates them again."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        places: Tensor,
        scale: float,
        *tables: Tensor,
    ) -> Tensor:
        levels = len(tables) // 2
        places, tables = places.contiguous(), tuple(table.contiguous() for table in tables)
        features = places.new_empty(len(places), levels * tables[0].shape[-1])
        planes, lines = _plain(tables[:levels]), _plain(tables[levels:])
        required().plane_product(places.detach(), planes, lines, scale, features, num_threads())
        ctx.save_for_backward(places, *tables)
        ctx.scale = scale
        return features

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        places, *tables = ctx.saved_tensors
        levels = len(tables) // 2
        to_places = torch.zeros_like(places)
        to_tables = [torch.zeros_like(table) for table in tables]
        required().plane_product_backward(
            places.detach(),
            _plain(tables[:levels]),
            _plain(tables[levels:]),
            ctx.scale,
            gradient.contiguous(),
            to_places,
            to_tables[:levels],
            to_tables[levels:],
            num_threads(),
        )
        return to_places, None, *to_tables


class _HashFeatures(torch.autograd.Function):
    """Interpolates rows of tables; backward finds the rows again."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        places: Tensor,
        time: float,
        sizes: tuple[tuple[int, int], ...],
        *tables: Tensor,
    ) -> Tensor:
        places, tables = places.contiguous(), tuple(table.contiguous() for table in tables)
        features = places.new_empty(len(places), len(tables) * tables[0].shape[1])
        required().hash_features(
            places, time, _plain(tables), list(sizes), list(PRIMES), features, num_threads()
        )
        ctx.save_for_backward(places, *tables)
        ctx.time, ctx.sizes = time, sizes
        return features

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        places, *tables = ctx.saved_tensors
        to_tables = [torch.zeros_like(table) for table in tables]
        required().hash_features_backward(
            places,
            ctx.time,
            _plain(tables),
            list(ctx.sizes),
            list(PRIMES),
            gradient.contiguous(),
            to_tables,
            num_threads(),
        )
        return None, None, None, *to_tables


class _Slices(torch.autograd.Function):
    """Slices rows; backward slices them again."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        *given: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        given = tuple(tensor.contiguous() for tensor in given)
        count = len(given[0])
        covariances = given[0].new_empty(count, 3, 3)
        velocities, variances = covariances.new_empty(count, 3), covariances.new_empty(count)
        required().slice(
            *_plain(given), covariances.view(count, 9), velocities, variances, num_threads()
        )
        ctx.save_for_backward(*given)
        return covariances, velocities, variances

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:  # noqa: ANN401
        given = ctx.saved_tensors
        covariances, velocities, variances = (gradient.contiguous() for gradient in gradients)
        found = [torch.empty_like(tensor) for tensor in given]
        required().slice_backward(
            *_plain(given), covariances.view(-1, 9), velocities, variances, *found, num_threads()
        )
        return tuple(found)


class _ReluNetwork(torch.autograd.Function):
    """Runs tiles of rows through all layers; backward runs them again."""

    @staticmethod
    def forward(
        ctx: Any,  # noqa: ANN401 - torch has no type for it
        inputs: Tensor,
        trunk: int,
        gate: Gate | None,
        *parameters: Tensor,
    ) -> tuple[Tensor, ...]:
        inputs = inputs.contiguous()
        parameters = tuple(parameter.contiguous() for parameter in parameters)
        weights, biases = _plain(parameters[::2]), _plain(parameters[1::2])
        outputs = [inputs.new_empty(len(inputs), len(head)) for head in weights[trunk:]]
        least = None if gate is None else gate.least.detach().contiguous()
        head = 0 if gate is None else gate.head
        required().network(
            inputs.detach(), weights, biases, trunk, least, head, outputs, num_threads()
        )
        closed = None if gate is None else gate.closed(outputs)
        ctx.save_for_backward(inputs, closed, *parameters)
        ctx.trunk, ctx.gate = trunk, gate
        return tuple(outputs)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        inputs, closed, *parameters = ctx.saved_tensors
        if ctx.gate is not None:
            gradients = ctx.gate.masked(gradients, closed)
        to_inputs = torch.zeros_like(inputs) if ctx.needs_input_grad[0] else None
        to_parameters = inputs.new_empty(sum(parameter.numel() for parameter in parameters))
        required().network_backward(
            inputs.detach(),
            _plain(parameters[::2]),
            _plain(parameters[1::2]),
            ctx.trunk,
            [gradient.contiguous() for gradient in gradients],
            to_inputs,
            to_parameters,
            num_threads(),
        )
        parts = to_parameters.split([parameter.numel() for parameter in parameters])
        shaped = (part.view_as(like) for part, like in zip(parts, parameters, strict=True))
        return to_inputs, None, None, *shaped


def _plain(tensors: Sequence[Tensor]) -> list[Tensor]:
    return [tensor.detach() for tensor in tensors]
