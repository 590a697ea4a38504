"""MovingCase: an extreme of time, for every dynamic method with the columns that it changes.

What is made extreme are columns, by name: a method that has a column ``log_durations`` gets the
cases of it, whoever wrote the method; of one that has not they are listed as not claimed. Methods
need no code for that, and do not choose their own examination.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import torch
from torch import Tensor

from gsfw.core.loop.optimizer import Optimizer, OptimizerSettings
from gsfw.core.method import Method
from gsfw.core.model import PrimitiveModel
from gsfw.core.operators import Operators
from gsfw.core.scene import Scene
from gsfw.plugins.loading import load
from gsfw.plugins.registry import Registry
from gsfw.studies.stress.case import Section, random_splats

Fill = Callable[[Tensor, torch.Generator], Tensor]
"""Gives new values of a column from the old ones."""

ROWS = 200
SPREAD = 0.1
"""Standard deviation of the values of networks and grids, and of the motion of rows from one time
to the next."""
INSIDE = (0.0, 0.25, 0.5, 1.0)
OUTSIDE = (-10.0, -1.0, -1e-6, 0.0, 0.5, 1.0, 1.0 + 1e-6, 2.0, 10.0)


@dataclass(frozen=True)
class MovingCase:
    """One extreme of time."""

    name: str
    columns: Mapping[str, Fill] = field(default_factory=dict)
    """New values by column; a method without one of these columns does not run the case."""
    times: tuple[float, ...] = INSIDE
    truth: Mapping[str, Fill] = field(default_factory=dict)
    """New values of columns in the float64 model where they differ, by name; both should look the
    same."""
    parameters: float = SPREAD
    """Standard deviation of trained parameters that are not one per splat."""
    needs_parameters: bool = False
    """True if these parameters are the extreme ones."""
    conditioning: str = ""
    """The reason why float32 misses the ordinary tolerances; it must then be no worse than some
    roundings of the parameters in float64. Empty: the ordinary tolerances hold."""

    @property
    def section(self) -> Section:
        """Section of the catalogue."""
        return Section.TIME

    def lacking(self, model: PrimitiveModel) -> str:
        """Columns or parameters that a model lacks for this case; empty when it has all."""
        missing = [name for name in self.columns if name not in model.columns()]
        if missing:
            return f"needs columns {', '.join(missing)}"
        if self.needs_parameters and not model.parameter_groups():
            return "needs parameters that are not one per splat"
        return ""

    @torch.no_grad()
    def fill_(self, model: PrimitiveModel, *, truth: bool = False) -> None:
        """Make a model extreme, in place; it is not projected, like models of files.

        Args:
            model: in float32.
            truth: whether it is the one that the other is held to.
        """
        fills = {**self.columns, **self.truth} if truth else self.columns
        generator = torch.Generator().manual_seed(2)
        for group in model.parameter_groups():
            for parameter in group.parameters:
                drawn = torch.randn(parameter.shape, generator=generator)
                parameter.copy_(self.parameters * drawn)
        for name, fill in fills.items():
            values = model.columns()[name].values
            values.copy_(fill(values, generator))


def constant(value: float) -> Fill:
    """A fill with one value."""
    return lambda values, _: torch.full_like(values, value)


def normal(size: float = 1.0) -> Fill:
    """A fill with random numbers of this size."""
    return lambda values, generator: size * torch.randn(values.shape, generator=generator)


def spread(low: float, high: float) -> Fill:
    """A fill with logarithms of numbers between two powers of ten."""
    ends = low * math.log(10.0), high * math.log(10.0)

    def fill(values: Tensor, generator: torch.Generator) -> Tensor:
        return ends[0] + (ends[1] - ends[0]) * torch.rand(values.shape, generator=generator)

    return fill


TURNED = {"quats": normal(), "time_quats": normal()}
THIN = {**TURNED, "log_scales": constant(math.log(1e-4))}

TILTED = (
    "a rounding of the rotation tilts a Gaussian whose axes differ by this much: its slices and "
    "velocities, which are ratios of the axes, change by that many roundings"
)
FAST = "splats move by their velocity times up to 10 durations of the sequence"
WILD = "a network with large weights multiplies the rounding of its inputs"

MOVING_CASES: tuple[MovingCase, ...] = (
    MovingCase("time/outside", times=OUTSIDE),
    MovingCase("time/sigma-1e-8", {"log_durations": constant(math.log(1e-8))}, conditioning=TILTED),
    MovingCase(
        "time/sigma-1e8",
        {"log_durations": constant(math.log(1e8))},
        times=OUTSIDE,
        conditioning=TILTED,
    ),
    MovingCase("time/sigma-of-any-size", {"log_durations": spread(-8.0, 8.0)}, conditioning=TILTED),
    MovingCase(
        "time/thin-and-long",
        {**THIN, "log_durations": constant(math.log(10.0))},
        conditioning=TILTED,
    ),
    MovingCase(
        "time/thin-and-endless",
        {**THIN, "log_durations": constant(math.log(1e8))},
        conditioning=TILTED,
    ),
    MovingCase("time/thin-and-short", {**THIN, "log_durations": constant(math.log(1e-8))}),
    MovingCase(
        "time/turned-of-any-size", {**TURNED, "log_scales": spread(-6.0, 0.0)}, conditioning=TILTED
    ),
    MovingCase(
        "time/rotors-1e4",
        {"quats": normal(1e4), "time_quats": normal(1e4)},
        truth=TURNED,
        conditioning=FAST,
    ),
    MovingCase(
        "time/rotors-1e-9",
        {"quats": normal(1e-9), "time_quats": normal(1e-9)},
        truth=TURNED,
        conditioning=FAST,
    ),
    MovingCase("time/rotors-0", {"quats": constant(0.0), "time_quats": constant(0.0)}),
    MovingCase("time/polynomials", {"motion": normal()}, (-10.0, 0.0, 10.0)),
    MovingCase("time/polynomials-1e3", {"motion": normal(1e3)}, OUTSIDE),
    MovingCase("time/spins-1e8", {"spins": normal(1e8)}, OUTSIDE),
    MovingCase("time/scales-of-any-size", {"log_scales": spread(-10.0, 6.0)}, conditioning=TILTED),
    MovingCase(
        "time/wild-field",
        parameters=3.0,
        needs_parameters=True,
        times=OUTSIDE,
        conditioning=WILD,
    ),
)
"""All cases of this section."""


def moving_model(method: str, registry: Registry) -> PrimitiveModel:
    """A model of a dynamic method with its defaults, in the state after training at three times.

    Raises:
        ConfigError: there is no such method.
    """
    config = load("method", registry.find("method", method))()
    built: Method = config.build()
    generator = torch.Generator().manual_seed(1)
    centers = torch.tensor([[0.0, 0.0, -4.0], [1.0, 0.0, -4.0]])
    points = torch.zeros(0, 3)
    scene = Scene("stress", points, points, centers, 2.0, time_range=(0.0, 10.0), num_times=11)
    model = built.build_model(scene, Operators(), generator, random_splats(ROWS))
    optimizer = Optimizer(model, Operators(), OptimizerSettings())
    for step, time in ((0, 0.0), (config.steps // 2, 0.5), (config.steps - 1, 1.0)):
        built.prepare(step, model, optimizer, time)
        with torch.no_grad():
            for name in ("means", "quats"):
                values = model.columns()[name].values
                values += SPREAD * torch.randn(values.shape, generator=generator)
    return model


def dynamic_methods(registry: Registry) -> list[str]:
    """Names of the dynamic methods."""
    return [name for name, spec in registry.slot("method").items() if "dynamic" in spec.tags]
