"""How the CUDA operators are chosen, and what they ask of the host."""

from typing import Any

import pytest
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from gsfw.core.loop.recording import CudaRecorder
from gsfw.core.operators import AdamMoments, AdamSettings, AdamUpdate, Operators
from gsfw.kernels.cuda import operators as module
from gsfw.kernels.cuda.operators import CudaOperators
from gsfw.plugins.loading import load_all
from gsfw.plugins.registry import installed


class Waiting(TorchDispatchMode):
    """Counts what would make the host wait for a GPU."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        waits = ("_local_scalar_dense", "nonzero", "masked_select", "_to_copy", "copy_", "equal")
        if any(func.name().startswith(f"aten::{name}") for name in waits):
            self.found.append(func.name())
        return func(*args, **(kwargs or {}))


def test_the_watch_for_waiting_sees_the_host_read_a_number():
    with Waiting() as waiting:
        float(torch.ones(()) + 1.0)
    assert waiting.found == ["aten::_local_scalar_dense"]


def test_the_host_waits_for_nothing(operators):
    rendered = torch.rand(1, 9, 9, 3, requires_grad=True)
    target, valid = torch.rand(1, 9, 9, 3), torch.ones(1, 9, 9, 1, dtype=torch.bool)
    values = torch.rand(20, 3)
    moments, rows = AdamMoments.zeros_like(values), torch.tensor([2, 7])
    with Waiting() as waiting:
        l1, dssim = operators.l1_dssim(rendered, target, valid)
        (0.8 * l1 + 0.2 * dssim).backward()
        finite = operators.all_finite([rendered.grad, values])
        for some in (None, rows):
            operators.adam_(
                [AdamUpdate(values, values.clone(), moments, 0.1, some)], AdamSettings(), finite
            )
    assert waiting.found == []
    assert moments.count == 2


def field_tensors(device: str = "cpu") -> list[Tensor]:
    """Places, planes, lines, a table, and quaternions, which are scales as well."""
    shapes = ((9, 3), (3, 4, 4, 2), (3, 4, 2), (64, 2), (9, 4))
    there = {"device": device, "dtype": torch.float64, "requires_grad": True}
    return [torch.rand(shape, **there) for shape in shapes]


def field_results(operators: Operators, tensors: list[Tensor], time: Tensor) -> list[Tensor]:
    """Outputs of all temporal fields, and the gradients of their sum."""
    places, planes, lines, table, quats = tensors
    outputs = [
        operators.plane_product(places, [planes], [lines], 1.0),
        operators.hash_features(places, time, [table], [(4, 2)]),
        *operators.slices(quats, quats, quats),
        operators.squared_differences(planes, (1, 2), 1, 1.0),
        operators.mean_distance(planes, 1.0, 1.0),
    ]
    return [*outputs, *torch.autograd.grad(sum(part.sum() for part in outputs), tensors)]


def test_the_host_waits_for_no_temporal_field(operators):
    tensors, time = field_tensors(), torch.rand((), dtype=torch.float64)
    with Waiting() as waiting:
        found = field_results(operators, tensors, time)
    assert waiting.found == []
    assert all(value.any() for value in found)


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU on this machine")
def test_a_graph_of_temporal_fields_follows_its_inputs():
    tensors = field_tensors("cuda")
    time = torch.rand((), dtype=torch.float64, device="cuda")
    recorder, found = CudaRecorder(torch.device("cuda", 0)), []
    with recorder.working():
        field_results(CudaOperators(), tensors, time)
        graph = recorder.record(lambda: found.extend(field_results(CudaOperators(), tensors, time)))
        with torch.no_grad():
            for tensor in (*tensors, time):
                tensor.mul_(0.9)
        graph.replay()
        expected = field_results(Operators(), tensors, time)
    torch.cuda.synchronize()
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other)


def test_a_gpu_with_kernels_is_served_before_anything_else(monkeypatch):
    monkeypatch.setattr(module, "unavailable", lambda: "")
    assert CudaOperators.preference(torch.device("cuda")) == 10
    assert CudaOperators.preference(torch.device("cpu")) is None


def test_a_gpu_without_kernels_is_left_to_torch(monkeypatch):
    monkeypatch.setattr(module, "unavailable", lambda: "there is no driver")
    assert CudaOperators.preference(torch.device("cuda")) is None


def test_the_set_is_installed():
    assert load_all("operators", installed())["cuda"] is CudaOperators


def test_tensors_of_the_cpu_are_left_to_torch():
    values = torch.rand(5, 3)
    before, moments = values.clone(), AdamMoments.zeros_like(values)
    operators = CudaOperators()
    finite = operators.all_finite([values])
    operators.adam_([AdamUpdate(values, torch.ones(5, 3), moments, 0.5)], AdamSettings(), finite)
    torch.testing.assert_close(values, before - 0.5)
    images = torch.rand(1, 8, 8, 3), torch.rand(1, 8, 8, 3)
    assert operators.l1_dssim(*images) == Operators().l1_dssim(*images)


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU on this machine")
def test_a_gpu_agrees_with_torch():
    rendered = torch.rand(2, 40, 50, 3, dtype=torch.float64, device="cuda", requires_grad=True)
    target = torch.rand(2, 40, 50, 3, dtype=torch.float64, device="cuda")
    for found, expected in zip(
        CudaOperators().l1_dssim(rendered, target),
        Operators().l1_dssim(rendered, target),
        strict=True,
    ):
        torch.testing.assert_close(found, expected)
        losses = (found, expected)
        # Both losses of a pair come from one pass, which is kept for the other.
        gradients = [torch.autograd.grad(loss, rendered, retain_graph=True)[0] for loss in losses]
        torch.testing.assert_close(*gradients)


@pytest.mark.cuda
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU on this machine")
@pytest.mark.parametrize(("axes", "k"), [(3, 20), (4, 8)])
def test_a_gpu_finds_the_neighbors_that_the_host_finds(axes, k):
    points = torch.rand(3000, axes, dtype=torch.float64, device="cuda")
    expected = Operators().neighbors(points, k)
    assert torch.equal(CudaOperators().neighbors(points, k), expected)
