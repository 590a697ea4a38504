"""`gsfw stress`: runs backends and dynamic methods through the catalogue of extremes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from gsfw.commands.interface.arguments import Options, read_options

if TYPE_CHECKING:
    from gsfw.commands.interface.console import Console
    from gsfw.plugins.registry import Registry
    from gsfw.studies.stress.plane import PlaneErrors
    from gsfw.studies.stress.result import CaseResult
    from gsfw.studies.stress.runner import StressPlan

FAILED = 1
"""Exit code if a case has failed."""

NONE = "none"


@dataclass(kw_only=True)
class StressOptions(Options):
    """Render a catalogue of extremes, and measure errors against the reference in float64.

    Exit codes: 0 every case has passed; 1 some have failed; 2 a mistake in the command.
    """

    examples: ClassVar[tuple[str, ...]] = (
        "gsfw stress out=stress.png",
        "gsfw stress rasterizer=cpu,reference method=4d-rotor dtype=float32",
        "gsfw stress rasterizer=cpu only=shape,*/fisheye",
        "gsfw stress list=true",
    )

    rasterizer: tuple[str, ...] = ()
    """Backends, each with settings if need be (cuda:deterministic); empty: all that run here and
    render by splatting's rule."""
    method: tuple[str, ...] = ()
    """Dynamic methods for the cases of time; empty: all; none: none of them."""
    dtype: tuple[Literal["float32", "float64"], ...] = ("float32", "float64")
    """Types to render in."""
    only: tuple[str, ...] = ()
    """Names or patterns of cases, or sections, such as shape,*/fisheye; empty: all."""
    out: str = NONE
    """File of the heat map of errors over scale, depth, anisotropy and opacity, such as
    stress.png; none: it is not made."""
    list: bool = False
    """List the cases, without running them."""


def run(arguments: list[str]) -> int:
    """Measure, and print the results."""
    options = read_options("stress", StressOptions, arguments)
    from gsfw.commands.interface.progress import load_torch

    load_torch()

    from gsfw.commands.interface.console import Console
    from gsfw.core.capabilities import Needs
    from gsfw.plugins.registry import installed
    from gsfw.studies.entrants import choose_all
    from gsfw.studies.stress.runner import StressPlan

    console, registry = Console(options.json), installed()
    if options.list:
        _list_cases(console, options.only)
        return 0
    chosen, missing = choose_all(options.rasterizer, registry, {"gsfw stress": Needs()})
    methods = _methods(options.method, registry)
    dtypes: tuple[str, ...] = tuple(dict.fromkeys(options.dtype))
    plan = StressPlan(chosen, methods, dtypes, options.only)
    for name, why in missing.items():
        console.say(f"rasterizer {name} is left out: {why}")
    results = _measured(console, plan, registry)
    planes = _planes(console, plan, registry, options.out)
    _show(console, results)
    if planes:
        console.say(f"written: {options.out}")
    console.result(_document(results, planes, missing, options.out if planes else ""))
    return FAILED if any(result.faults for result in results) else 0


def _methods(names: Sequence[str], registry: Registry) -> list[str]:
    """The dynamic methods to run.

    Raises:
        ConfigError: one is not installed, or is not dynamic.
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
                f"method={name}: it is not dynamic, and all cases for methods are cases of time.",
                f"Dynamic methods: {', '.join(dynamic) or 'none'}; method=none leaves them out.",
            )
    return wanted


def _measured(console: Console, plan: StressPlan, registry: Registry) -> list[CaseResult]:
    """Run all cases, with a progress bar."""
    from gsfw.commands.interface.progress import StageBars
    from gsfw.studies.stress.runner import run as measure_all

    results: list[CaseResult] = []
    with StageBars(console).stage("cases", len(plan)) as advance:
        for result in measure_all(plan, registry):
            results.append(result)
            advance(len(results))
    return results


def _planes(console: Console, plan: StressPlan, registry: Registry, out: str) -> list[PlaneErrors]:
    """Measure errors over planes and write the heat map; nothing without a file name."""
    from gsfw.commands.interface.progress import StageBars
    from gsfw.studies.stress.heat_map import write_heat_map
    from gsfw.studies.stress.plane import PLANES, PlaneOracle, plane_errors
    from gsfw.studies.stress.runner import reference

    if out == NONE or not plan.entrants:
        return []
    jobs = list(product(plan.entrants, plan.dtypes, PLANES))
    oracle, found = PlaneOracle(reference(registry)), []
    with StageBars(console).stage("planes", len(jobs)) as advance:
        for entrant, dtype, plane in jobs:
            found.append(plane_errors(entrant, dtype, plane, oracle))
            advance(len(found))
    write_heat_map(Path(out), found)
    return found


def _show(console: Console, results: Sequence[CaseResult]) -> None:
    """Print a table for each backend and dtype, the failures, and the totals."""
    from gsfw.studies.stress.result import tables, totals

    for table in () if console.json_only else tables(results):
        console.say()
        console.table(*table)
    failed = [result for result in results if result.faults]
    if failed:
        console.say("\nfailed:")
    for result in failed:
        console.say(f"  {result.backend}, {result.dtype}, {result.name}: {result.faults[0]}")
        for fault in result.faults[1:]:
            console.say(f"    {fault}")
    console.say()
    for total in totals(results):
        console.say(str(total))


def _document(
    results: Sequence[CaseResult],
    planes: Sequence[PlaneErrors],
    missing: Mapping[str, str],
    image: str,
) -> dict[str, Any]:
    """The JSON document.

    Args:
        results: results of all cases.
        planes: errors over planes.
        missing: causes of skipped rasterizers, by name.
        image: file of the heat map; empty without one.
    """
    from gsfw.studies.stress.result import totals

    return {
        "kind": "stress",
        "cases": [result.document() for result in results],
        "totals": [total.document() for total in totals(results)],
        "planes": [errors.document() for errors in planes],
        "missing": dict(missing),
        "image": image,
    }


def _list_cases(console: Console, only: Sequence[str]) -> None:
    """Print the names of cases, and the cause of each limit of float32.

    Raises:
        ConfigError: a pattern matches no case.
    """
    from gsfw.studies.stress.catalogue import CASES, chosen
    from gsfw.studies.stress.moving_case import MOVING_CASES
    from gsfw.studies.stress.runner import NAMES

    refusals = {name: ", ".join(case.refusal) for name, case in CASES.items() if case.refusal}
    notes = {case.name: case.conditioning for case in CASES.values()}
    notes |= {case.name: case.conditioning for case in MOVING_CASES}
    notes |= {name: f"must be refused: {parts}" for name, parts in refusals.items()}
    names = chosen(NAMES, only)
    console.table(["case", "note"], [[name, notes[name]] for name in names])
    console.say(f"{len(names)} cases")
    console.result({"cases": [{"name": name, "note": notes[name]} for name in names]})
