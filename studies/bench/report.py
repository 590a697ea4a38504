"""Report: the document of a measurement, and its tables and sentences for people."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from gsfw.studies.bench.machine import Limits, gpu, machine
from gsfw.studies.bench.rounds import Bench, Setup
from gsfw.studies.bench.steps import ssim_source
from gsfw.studies.table import Table

DIGITS = 6
"""Significant digits: clocks are no more precise."""

STAGES = {
    "image": (),
    "forward": ("project", "sort", "bin", "blend"),
    "backward": ("blend_backward", "project_backward"),
    "step": ("activation", "render", "loss", "step_backward", "check", "optimizer"),
}
"""Measured times, and the parts of each in the order in which they happen; image is forward and
backward together."""

ABSENT = "-"
"""Stands for a stage that a rasterizer does not measure."""


def document(
    bench: Bench, repeats: int, pairs: int, limits: Limits | None, memory_mb: float | None
) -> dict[str, Any]:
    """All measurements as plain data.

    Args:
        bench: after its last round.
        repeats: number of measured rounds.
        pairs: contributing (pixel, splat) pairs of the workload.
        limits: of this machine; ``None`` where they cannot be measured.
        memory_mb: peak of the process in all rounds, with Python and torch; ``None`` if unknown.
    """
    workload, cameras = bench.workload, bench.workload.cameras
    results = [
        _result(setup, timings.figures(), bench, pairs, limits)
        for setup, timings in bench.timings.items()
    ]
    report: dict[str, Any] = {
        "workload": {
            "name": workload.name,
            "description": workload.description,
            "splats": len(workload.splats),
            "contributing_pairs": pairs,
            "pairs_per_pixel": _rounded(pairs / (len(cameras) * cameras.width * cameras.height)),
        },
        "machine": machine() | {"gpu": gpu(bench.device)},
        "device": str(bench.device),
        "operators": bench.operators_name,
        "repeats": repeats,
        "peak_memory_mb": memory_mb,
        "results": results,
        "ratios": [_ratios(result, results[0]) for result in results[1:]],
    }
    if any(result["rasterizer"].startswith("gsplat") for result in results):
        report["own_step_ssim"] = ssim_source()
    if limits:
        report["limits"] = {
            "fma_gflops": _rounded(limits.fma_gflops),
            "exponential_gexp": _rounded(limits.exponential_gexp),
            "blend_ns_per_pair": _rounded(limits.forward_ns),
            "blend_backward_ns_per_pair": _rounded(limits.backward_ns),
        }
    return report


def _result(
    setup: Setup,
    figures: Mapping[str, float],
    bench: Bench,
    pairs: int,
    limits: Limits | None,
) -> dict[str, Any]:
    """Figures of one setup."""
    result: dict[str, Any] = {
        "rasterizer": setup.rasterizer,
        "threads": setup.threads,
        "details": dict(bench.entrants[setup.rasterizer].rasterizer.capabilities().details),
    }
    result |= {name: _rounded(value) for name, value in figures.items()}
    peaks = bench.peaks[setup]
    result |= {f"{name}_peak_mb": _rounded(value) for name, value in peaks.items()}
    if "step_kernels_ms" in figures:
        outside = 1.0 - figures["step_kernels_ms"] / figures["step_ms"]
        result["step_outside_kernels"] = _rounded(outside)
    for stage in ("forward", "backward", "blend", "blend_backward"):
        if pairs and f"{stage}_ms" in figures:
            per_pair = figures[f"{stage}_ms"] * 1e6 / pairs
            result[f"{stage}_ns_per_pair"] = _rounded(per_pair)
            least = _least(stage, limits)
            if least is not None and per_pair > 0:
                result[f"{stage}_of_limit"] = _rounded(least / per_pair)
    return result


def _least(stage: str, limits: Limits | None) -> float | None:
    """Least time per pair of a stage, in nanoseconds; ``None`` where no limit is known."""
    if limits is None:
        return None
    return {"blend": limits.forward_ns, "blend_backward": limits.backward_ns}.get(stage)


def _ratios(result: Mapping[str, Any], first: Mapping[str, Any]) -> dict[str, Any]:
    """Medians of a setup over medians of the first one, by stage."""
    cpu: dict[str, float] = {}
    wall: dict[str, float] = {}
    for key in result:
        measured = key.endswith("_ms") and not key.endswith(
            ("_min_ms", "_min_wall_ms", "_spread_ms")
        )
        if measured and first.get(key, 0.0) > 0.0:
            clock, end = (wall, "_wall_ms") if key.endswith("_wall_ms") else (cpu, "_ms")
            clock[key.removesuffix(end)] = _rounded(result[key] / first[key])
    return {
        "rasterizer": result["rasterizer"],
        "threads": result["threads"],
        "to": {"rasterizer": first["rasterizer"], "threads": first["threads"]},
        "cpu": cpu,
        "wall": wall,
        "peak": {
            key.removesuffix("_peak_mb"): _rounded(result[key] / first[key])
            for key in result
            if key.endswith("_peak_mb") and first.get(key, 0.0) > 0.0
        },
    }


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def heading(report: Mapping[str, Any]) -> list[str]:
    """Lines on the machine."""
    machine = report["machine"]
    native = machine["instruction_set"] or "no native module"
    lines = [
        f"{machine['cpu']}, {machine['cores']} cores ({native}); "
        f"torch {machine['torch']}, gsfw {machine['gsfw']}"
    ]
    gpu = machine["gpu"]
    return [*lines, f"rendered on {gpu['name']}, CUDA {gpu['cuda']}"] if gpu else lines


def clock_tables(report: Mapping[str, Any]) -> list[Table]:
    """Times by the processor's own clock, and wall times."""
    own = "time of the GPU" if report["machine"]["gpu"] else "CPU time over all threads"
    end = f"median of {report['repeats']} in ms"
    clocks = (("cpu", own), ("wall", "wall time"))
    return [
        Table(_columns(report), _rows(report, clock), f"{title}, {end}") for clock, title in clocks
    ]


def sentences(report: Mapping[str, Any]) -> list[str]:
    """Lines on the figures of each setup."""
    results = report["results"]
    return [f"{_name(result)}: {line}" for result in results for line in _lines(result, report)]


def more_tables(report: Mapping[str, Any]) -> list[Table]:
    """Tables of the further measurements that were asked for."""
    return [table(report[name]) for name, table in MORE.items() if name in report]


def limits_line(limits: Mapping[str, float]) -> str:
    """The limits of this machine."""
    return (
        f"this machine, one thread: {limits['fma_gflops']:.0f} GFLOP/s of fused multiply-adds, "
        f"{limits['exponential_gexp']:.2f} exponentials per ns"
    )


def _agreement(scenes: Mapping[str, Mapping[str, Any]]) -> Table:
    """Errors by rasterizer and scenes."""
    columns = {
        f"{name}, {which}": e for name, found in scenes.items() for which, e in found.items()
    }
    errors = list(columns.values())
    rows = [[key, *(f"{error[key]:.2g}" for error in errors)] for key in errors[0]]
    title = "distance to the float64 reference (relative; largest and flips are not)"
    return Table(["", *columns], rows, title)


def _first_use(rasterizers: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Table:
    """Seconds by rasterizer and state of the cache."""
    columns = {
        f"{name}, {s}": took for name, found in rasterizers.items() for s, took in found.items()
    }
    took = list(columns.values())
    rows = [
        [key.removesuffix("_seconds").replace("_", " "), *(f"{found[key]:.2f}" for found in took)]
        for key in took[0]
    ]
    title = "seconds of a new process, with an empty cache of kernels (cold) and with a filled one"
    return Table(["", *columns], rows, title)


def _sorts(found: Sequence[Mapping[str, Any]]) -> Table:
    """Times of both sorts."""
    rows = [
        [
            f"{item['keys']:,} keys of {item['bits']} bits ({item['sort']})",
            f"{item['radix_sort_ms']:.3f}",
            f"{item['torch_sort_ms']:.3f}",
            "yes" if item["same"] else "NO",
        ]
        for item in found
    ]
    return Table(["", "radix_sort", "torch.sort", "same order"], rows, "sorting, median in ms")


MORE: dict[str, Callable[[Any], Table]] = {
    "agreement": _agreement,
    "first_use": _first_use,
    "sorts": _sorts,
}
"""Tables of measurements that are made on request, by their keys in the document."""


def _name(result: Mapping[str, Any]) -> str:
    threads = result["threads"]
    if not threads:  # On a GPU.
        return str(result["rasterizer"])
    return f"{result['rasterizer']}, {threads} thread{'s' if threads > 1 else ''}"


def _columns(report: Mapping[str, Any]) -> list[str]:
    """A column for each setup, and one for each ratio to the first."""
    names = [_name(result) for result in report["results"]]
    return ["", *names, *(f"{name} / first" for name in names[1:])]


def _rows(report: Mapping[str, Any], clock: str) -> list[Sequence[str]]:
    """A row for each stage; numbers are right-aligned."""
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
    """Indentation and name of every stage that any setup measured."""
    end = "_min_wall_ms"
    measured = {key.removesuffix(end) for item in results for key in item if key.endswith(end)}
    stages: list[tuple[str, str]] = []
    for whole, parts in STAGES.items():
        stages += [("", whole), *(("  ", part) for part in parts if part in measured)]
    known = {stage for _, stage in stages}
    return stages + [("", stage) for stage in sorted(measured - known - {"step_kernels"})]


def _aligned(value: float | None, digits: int) -> str:
    return f"{ABSENT if value is None else f'{value:.{digits}f}':>9}"


def _lines(result: Mapping[str, Any], report: Mapping[str, Any]) -> list[str]:
    """Figures of a setup in words."""
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
    if "image_peak_mb" in result:
        lines.append(
            f"{result['image_peak_mb']:,.0f} MB for an image and its gradients at most, "
            f"{result['step_peak_mb']:,.0f} MB for a step"
        )
    if "step_outside_kernels" in result:
        lines.append(f"{result['step_outside_kernels']:.0%} of a step is outside the kernels")
    return lines
