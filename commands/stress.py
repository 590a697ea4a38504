"""`gsfw stress`: holds backends and dynamic methods to the catalogue of extremes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from gsfw.commands.arguments import Options, read

if TYPE_CHECKING:
    from gsfw.commands.console import Console
    from gsfw.plugins.registry import Registry
    from gsfw.studies.stress.entrant import Entrant
    from gsfw.studies.stress.plane import PlaneErrors
    from gsfw.studies.stress.result import CaseResult
    from gsfw.studies.stress.runner import StressPlan

FAILED = 1
"""Exit code where a case has failed."""

NONE = "none"


@dataclass(kw_only=True)
class StressOptions(Options):
    """Draw a catalogue of extremes, and measure errors against the reference in float64.

    Exit codes: 0 every case has passed; 1 some have failed; 2 a mistake in the command.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw stress out=stress.png",
        "gsfw stress rasterizer=cpu,reference method=4d-rotor dtype=float32",
        "gsfw stress rasterizer=cpu only=shape,*/fisheye",
        "gsfw stress list=true",
    )

    rasterizer: tuple[str, ...] = ()
    """Backends to hold to it; empty: all that run here and draw what the reference draws."""
    method: tuple[str, ...] = ()
    """Dynamic methods for the cases of time; empty: all; none: none of them."""
    dtype: tuple[Literal["float32", "float64"], ...] = ("float32", "float64")
    """Types in which it is drawn."""
    only: tuple[str, ...] = ()
    """Names or patterns of cases, or sections, such as shape,*/fisheye; empty: all."""
    out: str = NONE
    """Where to write the heat map of errors over scale, depth, anisotropy and opacity, such as
    stress.png; none: it is not made."""
    list: bool = False
    """List the cases; run nothing."""


def run(arguments: list[str]) -> int:
    """Measure, and tell."""
    options = read("stress", StressOptions, arguments)

    from gsfw.commands.console import Console
    from gsfw.commands.stress_report import document, list_cases, tell
    from gsfw.plugins.registry import installed
    from gsfw.studies.stress.entrant import entrants
    from gsfw.studies.stress.runner import StressPlan

    console, registry = Console(options.json), installed()
    if options.list:
        list_cases(console, options.only)
        return 0
    chosen, missing = entrants(options.rasterizer, registry)
    methods = _methods(options.method, registry)
    dtypes: tuple[str, ...] = tuple(dict.fromkeys(options.dtype))
    plan = StressPlan(chosen, methods, dtypes, options.only)
    for name, why in missing.items():
        console.say(f"rasterizer {name} is left out: {why}")
    results = _measured(console, plan, registry)
    planes = _planes(console, plan, registry, options.out)
    tell(console, results)
    if planes:
        console.say(f"written: {options.out}")
    console.result(document(results, planes, missing, options.out if planes else ""))
    return FAILED if any(result.faults for result in results) else 0


def _methods(names: Sequence[str], registry: Registry) -> list[str]:
    """The methods that are asked for.

    Raises:
        ConfigError: one is not there, or is not dynamic.
    """
    from gsfw.core.errors import ConfigError
    from gsfw.studies.stress.moving_case import dynamic_methods

    dynamic = dynamic_methods(registry)
    if not names:
        return dynamic
    wanted = [name for name in names if name != NONE]
    for name in wanted:
        if name not in dynamic:
            registry.find("method", name)
            raise ConfigError(
                f"method={name}: it is not dynamic, and cases of time are all that methods are "
                "held to.",
                f"Dynamic methods: {', '.join(dynamic) or 'none'}; method=none leaves them out.",
            )
    return wanted


def _measured(console: Console, plan: StressPlan, registry: Registry) -> list[CaseResult]:
    """All results, with a bar."""
    from gsfw.commands.stage_bars import StageBars
    from gsfw.studies.stress.runner import run as measure_all

    results: list[CaseResult] = []
    with StageBars(console).stage("cases", len(plan)) as advance:
        for result in measure_all(plan, registry):
            results.append(result)
            advance(len(results))
    return results


def _planes(console: Console, plan: StressPlan, registry: Registry, out: str) -> list[PlaneErrors]:
    """Errors over planes, drawn to a file; none where no file is asked for."""
    from gsfw.commands.stage_bars import StageBars
    from gsfw.studies.stress.heat_map import write_heat_map
    from gsfw.studies.stress.plane import PLANES, Plane, PlaneOracle, plane_errors
    from gsfw.studies.stress.runner import reference

    if out == NONE or not plan.entrants:
        return []
    jobs: list[tuple[Entrant, str, Plane]] = [
        (entrant, dtype, plane)
        for entrant in plan.entrants
        for dtype in plan.dtypes
        for plane in PLANES
    ]
    oracle, found = PlaneOracle(reference(registry)), []
    with StageBars(console).stage("planes", len(jobs)) as advance:
        for entrant, dtype, plane in jobs:
            found.append(plane_errors(entrant, dtype, plane, oracle))
            advance(len(found))
    write_heat_map(Path(out), found)
    return found
