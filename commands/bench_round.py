"""Round: every rasterizer with every number of threads, once and in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from gsfw.commands.bench_step import TrainingStep
from gsfw.commands.bench_timing import Timings
from gsfw.commands.bench_workload import SEED, Workload
from gsfw.core.rasterizer import Rasterizer
from gsfw.core.render_settings import RenderSettings, Validation
from gsfw.core.splats import Sh, Splats
from gsfw.plugins.automatic import load_all
from gsfw.plugins.compose import choose_operators
from gsfw.plugins.registry import Registry

SETTINGS = RenderSettings(validation=Validation.CHEAP)
"""As in training."""


@dataclass(frozen=True)
class Entrant:
    """One rasterizer with one number of threads."""

    rasterizer: str
    threads: int


class Bench:
    """Measures all entrants on one workload."""

    def __init__(
        self,
        workload: Workload,
        rasterizers: Mapping[str, Rasterizer],
        threads: Sequence[int],
        registry: Registry,
    ) -> None:
        self.workload = workload
        self.operators = choose_operators(registry, torch.device("cpu"))
        kinds = load_all("operators", registry)
        self.operators_name = next(
            name for name, kind in kinds.items() if type(self.operators) is kind
        )
        self.details = {name: item.capabilities().details for name, item in rasterizers.items()}
        self.timings: dict[Entrant, Timings] = {}
        self._rasterizers = rasterizers
        self._entrants = [Entrant(name, count) for count in threads for name in rasterizers]
        self._splats = _leaves(workload.splats)
        self._step = TrainingStep(workload, self.operators, SETTINGS)
        cameras = workload.cameras
        shape = (len(cameras), cameras.height, cameras.width, workload.splats.channels)
        self._gradient = torch.randn(shape, generator=torch.Generator().manual_seed(SEED))
        self.forget()

    def forget(self) -> None:
        """Begin the figures anew."""
        self.timings = {entrant: Timings() for entrant in self._entrants}

    def round(self) -> None:
        """Let every entrant draw, forward and backward, and then do a training step."""
        for entrant, timings in self.timings.items():
            torch.set_num_threads(entrant.threads)
            rasterizer = self._rasterizers[entrant.rasterizer]
            if len(self.timings) > 1:
                # After another's turn threads sleep and caches are cold, as they never are in
                # training: one picture that does not count.
                self._draw(rasterizer, Timings())
            self._draw(rasterizer, timings)
            self._step.measure(rasterizer, timings)

    def _draw(self, rasterizer: Rasterizer, timings: Timings) -> None:
        for tensor in self._splats.tensors().values():
            tensor.grad = None
        with timings.stage("forward"):
            output = rasterizer.render(self._splats, self.workload.cameras, SETTINGS)
        with timings.stage("backward"):
            output.color.backward(self._gradient)
        for name, reading in rasterizer.stage_times().items():
            timings.add(name, reading)


def _leaves(splats: Splats) -> Splats:
    """The same splats, every field a leaf that gathers a gradient."""

    def leaf(tensor: Tensor) -> Tensor:
        return tensor.clone().requires_grad_()

    assert splats.quats is not None
    assert splats.scales is not None
    colors = splats.colors
    return Splats(
        means=leaf(splats.means),
        opacities=leaf(splats.opacities),
        colors=colors.map(leaf) if isinstance(colors, Sh) else leaf(colors),
        quats=leaf(splats.quats),
        scales=leaf(splats.scales),
    )
