"""Table: a measurement as people read it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gsfw.commands.interface.console import Console

STAGES = {
    "picture": (),
    "forward": ("project", "sort", "bin", "blend"),
    "backward": ("blend_backward", "project_backward"),
    "step": ("activation", "render", "loss", "step_backward", "check", "optimizer"),
}
"""What is measured, and the parts of each, in the order in which they happen; picture is forward
and backward together."""

Part = tuple[list[str], list[list[str]], str]
"""Columns, rows and title of a table."""

ABSENT = "-"
"""Where a rasterizer does not measure a stage."""


def show(console: Console, report: Mapping[str, Any]) -> None:
    """Print CPU times, wall times, and what they mean per pair."""
    results, machine = report["results"], report["machine"]
    native = machine["instruction_set"] or "no native module"
    console.say(
        f"{machine['cpu']}, {machine['cores']} cores ({native}); "
        f"torch {machine['torch']}, gsfw {machine['gsfw']}"
    )
    gpu = machine["gpu"]
    if gpu:
        console.say(f"drawn on {gpu['name']}, CUDA {gpu['cuda']}")
    own = "time of the GPU" if gpu else "CPU time over all threads"
    for clock, title in (("cpu", own), ("wall", "wall time")):
        console.say()
        console.table(
            _columns(report),
            _rows(report, clock),
            f"{title}, median of {report['repeats']} in ms",
        )
    console.say()
    for result in results:
        for line in _sentences(result, report):
            console.say(f"{_name(result)}: {line}")
    for name, part in MORE.items():
        if name in report:
            console.say()
            console.table(*part(report[name]))
    if "limits" in report:
        limits = report["limits"]
        console.say(
            f"this machine, one thread: {limits['fma_gflops']:.0f} GFLOP/s of fused multiply-adds, "
            f"{limits['exponential_gexp']:.2f} exponentials per ns"
        )


def _agreement(
    scenes: Mapping[str, Mapping[str, Any]],
) -> Part:
    """Errors by rasterizer and scenes."""
    columns = [(name, which) for name, found in scenes.items() for which in found]
    errors = [scenes[name][which] for name, which in columns]
    rows = [[key, *(f"{error[key]:.2g}" for error in errors)] for key in errors[0]]
    title = "distance to the float64 reference (relative; largest and flips are not)"
    return ["", *(f"{name}, {which}" for name, which in columns)], rows, title


def _first_use(
    rasterizers: Mapping[str, Mapping[str, Mapping[str, float]]],
) -> Part:
    columns = [(name, state) for name, found in rasterizers.items() for state in found]
    took = [rasterizers[name][state] for name, state in columns]
    rows = [
        [key.removesuffix("_seconds").replace("_", " "), *(f"{found[key]:.2f}" for found in took)]
        for key in took[0]
    ]
    title = "seconds of a new process, with an empty cache of kernels (cold) and with a filled one"
    return ["", *(f"{name}, {state}" for name, state in columns)], rows, title


def _sorts(found: Sequence[Mapping[str, Any]]) -> Part:
    rows = [
        [
            f"{item['keys']:,} keys of {item['bits']} bits ({item['sort']})",
            f"{item['radix_sort_ms']:.3f}",
            f"{item['torch_sort_ms']:.3f}",
            "yes" if item["same"] else "NO",
        ]
        for item in found
    ]
    return ["", "radix_sort", "torch.sort", "same order"], rows, "sorting, median in ms"


MORE: dict[str, Callable[[Any], Part]] = {
    "agreement": _agreement,
    "first_use": _first_use,
    "sorts": _sorts,
}
"""What is measured besides, where it was asked for."""


def _name(entrant: Mapping[str, Any]) -> str:
    threads = entrant["threads"]
    if not threads:  # On a GPU.
        return str(entrant["rasterizer"])
    return f"{entrant['rasterizer']}, {threads} thread{'s' if threads > 1 else ''}"


def _columns(report: Mapping[str, Any]) -> list[str]:
    """One column per entrant, and one per entrant that is compared with the first."""
    names = [_name(result) for result in report["results"]]
    return ["", *names, *(f"{name} / first" for name in names[1:])]


def _rows(report: Mapping[str, Any], clock: str) -> list[Sequence[str]]:
    """Stage by stage, numbers right-aligned."""
    end = "_ms" if clock == "cpu" else "_wall_ms"
    results, ratios = report["results"], [item[clock] for item in report["ratios"]]
    stages = [(f"{indent}{stage}", stage) for indent, stage in _stages(results)]
    columns = [
        [_aligned(result.get(f"{stage}{end}"), 2) for _, stage in stages] for result in results
    ]
    columns += [[_aligned(ratio.get(stage), 3) for _, stage in stages] for ratio in ratios]
    labels = [label.replace("_", " ") for label, _ in stages]
    return list(zip(labels, *columns, strict=True))


def _stages(results: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """Indentation and name of every stage that any entrant measured."""
    end = "_min_wall_ms"
    measured = {key.removesuffix(end) for item in results for key in item if key.endswith(end)}
    stages: list[tuple[str, str]] = []
    for whole, parts in STAGES.items():
        stages += [("", whole), *(("  ", part) for part in parts if part in measured)]
    known = {stage for _, stage in stages}
    return stages + [("", stage) for stage in sorted(measured - known - {"step_kernels"})]


def _aligned(value: float | None, digits: int) -> str:
    return f"{ABSENT if value is None else f'{value:.{digits}f}':>9}"


def _sentences(result: Mapping[str, Any], report: Mapping[str, Any]) -> list[str]:
    """What an entrant's figures say."""
    lines: list[str] = []
    if "forward_ns_per_pair" in result:
        pairs = report["workload"]["contributing_pairs"] / 1e6
        lines.append(
            f"{result['forward_ns_per_pair']:.2f} ns forward and "
            f"{result['backward_ns_per_pair']:.2f} ns backward per contributing pair of a pixel "
            f"and a splat ({pairs:.2f} million)"
        )
    for stage, words in (("blend", "forward"), ("blend_backward", "backward")):
        if f"{stage}_of_limit" in result:
            lines.append(
                f"blending {words} runs at {result[f'{stage}_of_limit']:.0%} of the limit "
                f"({report['limits'][f'{stage}_ns_per_pair']:.2f} ns per contributing pair)"
            )
    if "picture_peak_mb" in result:
        lines.append(
            f"{result['picture_peak_mb']:,.0f} MB for a picture and its gradients at most, "
            f"{result['step_peak_mb']:,.0f} MB for a step"
        )
    if "step_outside_kernels" in result:
        lines.append(f"{result['step_outside_kernels']:.0%} of a step is outside the kernels")
    return lines
