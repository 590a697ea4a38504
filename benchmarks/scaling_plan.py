"""A paper plan for very large scenes: formulas, checked on this machine, and simulated with them.

    python benchmarks/scaling_plan.py [FIGURE.png] [train=true] [costs=COSTS.json]

measures the costs of a Gaussian, a pair, a pixel and a byte on this machine (some minutes on two
cores), prints each formula beside a measured small case, and then the plan: 10^4 to 10^7 images
and 10^6 to 10^10 Gaussians. train=false leaves out the checks that need runs; costs= reads the
costs of an earlier measurement, or writes them there. Machines, network and failures of the plan
are assumptions, the constants of ``scaling_ways``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import scaling_checks as checks
from printing import say
from scaling_costs import compute_costs, network_times, with_network
from scaling_formulas import Costs
from scaling_ways import IMAGE_BYTES, SCENES, VIEW, Planner, readable

from gsfw.charts.lines import Line, LinePanel, line_figure
from gsfw.charts.style import write_figure

HEAD = (
    "| way | machines | memory of each | bytes sent, a step | s a step, gloo as measured "
    "| 10 Gbit/s | 100 Gbit/s | hours | photos read, a machine and second | |",
    "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
)


def draw(path: Path, planner: Planner) -> None:
    """Plot hours and memory over the number of Gaussians."""
    hours: dict[str, list[tuple[float, float]]] = {}
    memory: dict[str, list[tuple[float, float]]] = {}
    for images, rows in SCENES:
        for plan in planner.plans(images, rows):
            memory.setdefault(plan.mode, []).append((rows, plan.memory_mb / 1e3))
            if plan.works:
                hours.setdefault(plan.mode, []).append((rows, plan.hours))
    panels = [
        LinePanel(title, "Gaussians", _lines(found), doubling=True, decades=True)
        for title, found in (("Hours of training", hours), ("GB of a process", memory))
    ]
    write_figure(path, line_figure(panels, columns=3))


def _lines(found: dict[str, list[tuple[float, float]]]) -> tuple[Line, ...]:
    return tuple(Line(name, tuple(points)) for name, points in found.items())


def measured(given: dict[str, str]) -> Planner:
    """Costs from a file, or measured, with their checks."""
    path = Path(given["costs"]) if "costs" in given else None
    if path is not None and path.exists():
        document = json.loads(path.read_text())
        return Planner(Costs(**document["costs"]), document["steps"])
    times = network_times()
    costs = with_network(compute_costs(), times)
    say(*(f"{name}: {value:.3g}" for name, value in asdict(costs).items()), "")
    say("| | formula | measured | ratio", "| --- | --- | --- | ---")
    for check in (*checks.computing_checks(costs), *checks.exchange_checks(costs, times)):
        say(check.line())
    steps: Sequence[float] = (1.0,)
    if given.get("train", "true") == "true":
        one, more = checks.trained(checks.POINTS), checks.trained(checks.MORE)
        runs = (one, more, checks.trained(checks.POINTS, 2))
        for check in checks.training_checks(costs, runs):
            say(check.line())
        steps = one.steps
    for check in checks.fault_checks():
        say(check.line())
    if path is not None:
        path.write_text(json.dumps({"costs": asdict(costs), "steps": list(steps)}, indent=1))
    return Planner(costs, steps)


def main(arguments: Sequence[str]) -> int:
    """Measure, check, and print the plan."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("given", nargs="*", metavar="FIGURE.png|KEY=VALUE")
    words: Sequence[str] = parser.parse_args(arguments).given
    given = dict(item.split("=", 1) for item in words if "=" in item)
    planner = measured(given)
    factors = (f"{planner.waiting(size):.2f} of {size}" for size in (2, 8, 16, 128))
    say("", f"waiting for the slowest: {', '.join(factors)}")
    for images, rows in SCENES:
        stored = readable(images * VIEW.pixels * IMAGE_BYTES)
        say("", f"{images:,.0f} images ({stored}), {rows:,.0f} Gaussians", "", *HEAD)
        say(*(plan.line() for plan in planner.plans(images, rows)))
    for path in (item for item in words if "=" not in item):
        draw(Path(path), planner)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
