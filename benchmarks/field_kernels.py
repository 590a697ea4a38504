"""Times temporal fields and their gradients on a GPU, in plain torch and in kernels.

    PYTHONPATH=... python benchmarks/field_kernels.py [--rows 100000] [--kernels]

Sizes are the defaults of ``method=4dgs``; the gradient of half of the rows is 0, as where no pixel
shows them. For each operation: milliseconds of a forward and a backward pass one by one, and as a
CUDA graph, which does not wait for the host; and the largest difference of any result, relative to
the largest number of a tensor. ``--kernels`` lists what the GPU does in each case.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from printing import say
from step_kernels import kernels, pace
from torch import Tensor

from gsfw.core.loop.recording import CudaRecorder
from gsfw.core.operators import Operators
from gsfw.methods.gaussians4d.config import HashConfig, HexPlaneConfig
from gsfw.methods.gaussians4d.decoder import Decoder, HiddenLayers
from gsfw.methods.gaussians4d.hash_grid import HashGrid
from gsfw.methods.gaussians4d.hexplane import HexPlane
from gsfw.plugins.loading import choose_operators
from gsfw.plugins.registry import installed
from gsfw.studies.bench.timing import warm_up

TIMES = 25
"""Cells along time."""

OUTPUTS = {"means": 3, "log_scales": 3, "quats": 4, "opacity_logits": 1}
"""Outputs of the decoder, one of which is a gate."""


@dataclass(frozen=True)
class Case:
    """An operation, with what it is differentiated by."""

    outputs: Callable[[], Sequence[Tensor]]
    inputs: Sequence[Tensor]

    def results(self, flows: Sequence[Tensor]) -> list[Tensor]:
        """Outputs, and all gradients from those of the outputs."""
        outputs = [*self.outputs()]
        gradients = torch.autograd.grad(outputs, self.inputs, flows)
        return [*(output.detach() for output in outputs), *gradients]


Made = Callable[[Operators, int, torch.device], Case]
"""A case for some operators, rows, and a device."""


def main() -> int:
    """Measure, and print a line for each operation."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rows", type=int, default=100_000, help="Gaussians")
    parser.add_argument("--kernels", action="store_true", help="list what the GPU does")
    options = parser.parse_args()
    if not torch.cuda.is_available():
        say("there is no GPU to use: torch sees none")
        return 3
    device = torch.device("cuda", 0)
    sets = {"torch": Operators(), "kernels": choose_operators(installed(), device)}
    say(f"{torch.cuda.get_device_name(device)}, {options.rows} rows, milliseconds")
    recorder = CudaRecorder(device)
    with recorder.working():
        warm_up(device)
        for name, made in CASES.items():
            cases = {kind: made(found, options.rows, device) for kind, found in sets.items()}
            say(f"{name}: {difference(cases['kernels'], cases['torch']):.1e} apart")
            for kind, case in cases.items():
                measure(kind, case, recorder, options.kernels)
    return 0


def measure(kind: str, case: Case, recorder: CudaRecorder, listed: bool) -> None:
    """Time the forward and backward pass of a case."""
    step = partial(once, case, flows_of(case))
    alone = pace(step)
    try:
        together = f"{pace(recorder.record(step).replay):.3f}"
    except RuntimeError as error:
        together = f"impossible ({str(error).splitlines()[0]})"
    say(f"  {kind:8} one by one {alone:.3f}, as a CUDA graph {together}")
    if listed:
        kernels(step)


def once(case: Case, flows: Sequence[Tensor]) -> None:
    """One forward and backward pass."""
    case.results(flows)


def flows_of(case: Case) -> list[Tensor]:
    """Incoming gradients; every second row has none."""
    generator = torch.Generator(case.inputs[0].device).manual_seed(1)
    flows = []
    for output in case.outputs():
        flow = torch.rand(output.shape, device=output.device, generator=generator)
        if flow.dim() > 0:
            flow[::2] = 0
        flows.append(flow)
    return flows


def difference(case: Case, other: Case) -> float:
    """Largest difference of the results of two cases, relative to the largest number."""
    flows = flows_of(case)
    pairs = zip(case.results(flows), other.results(flows), strict=True)
    return max(float((a - b).abs().max() / b.abs().max().clamp_min(1e-30)) for a, b in pairs)


def random(*shape: int, device: torch.device) -> Tensor:
    """Numbers in [0, 1), always the same."""
    return torch.rand(shape, generator=torch.Generator().manual_seed(0)).to(device)


def places_of(rows: int, device: torch.device) -> Tensor:
    """Places, a few of them beyond the box."""
    return (2.1 * random(rows, 3, device=device) - 1.05).requires_grad_()


def planes(operators: Operators, rows: int, device: torch.device) -> Case:
    """Features of planes, by places and cells."""
    encoder = hexplane(operators, device)
    places, time = places_of(rows, device), torch.tensor(0.3, device=device)
    return Case(lambda: [encoder(places, time)], [places, *encoder.parameters()])


def regularisers(operators: Operators, rows: int, device: torch.device) -> Case:
    """All regularisers of the planes."""
    encoder = hexplane(operators, device)
    return Case(lambda: [*encoder.regularizers().values()], [*encoder.parameters()])


def hexplane(operators: Operators, device: torch.device) -> HexPlane:
    """Planes of the default size."""
    generator = torch.Generator().manual_seed(0)
    return HexPlane(HexPlaneConfig(), TIMES, operators, generator).to(device)


def tables(operators: Operators, rows: int, device: torch.device) -> Case:
    """Features of a hash grid, by its tables."""
    generator = torch.Generator().manual_seed(0)
    encoder = HashGrid(HashConfig(), TIMES, operators, generator).to(device)
    places, time = places_of(rows, device), torch.tensor(0.3, device=device)
    return Case(lambda: [encoder(places, time)], [*encoder.parameters()])


def slices(operators: Operators, rows: int, device: torch.device) -> Case:
    """Slices of Gaussians of space and time."""
    left, right, scales = (random(3, rows, 4, device=device) + 0.1).unbind(0)
    inputs = [left.requires_grad_(), right.requires_grad_(), scales.requires_grad_()]
    return Case(lambda: operators.slices(*inputs), inputs)


def field(operators: Operators, rows: int, device: torch.device) -> Case:
    """Planes, network with a gate, and regularisers: all that a fine step adds to a static one."""
    encoder, config = hexplane(operators, device), HexPlaneConfig()
    layers = HiddenLayers(config.width, config.depth, config.width)
    generator = torch.Generator().manual_seed(0)
    decoder = Decoder(encoder.features, layers, OUTPUTS, operators, generator).to(device)
    places, time = places_of(rows, device), torch.tensor(0.3, device=device)
    least = ("opacity_logits", torch.full((rows,), -1.0, device=device))

    def outputs() -> list[Tensor]:
        changes = decoder(encoder(places, time), least=least)
        return [*changes.values(), *encoder.regularizers().values()]

    return Case(outputs, [places, *encoder.parameters(), *decoder.parameters()])


CASES: dict[str, Made] = {
    "planes": planes,
    "regularisers": regularisers,
    "hash grid": tables,
    "slices": slices,
    "field of 4dgs": field,
}
"""Operations by name."""


if __name__ == "__main__":
    sys.exit(main())
