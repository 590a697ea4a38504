"""Report: the document of a measurement: figures, what they mean per pair, and ratios."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gsfw.studies.bench.device import gpu
from gsfw.studies.bench.gsplat_step import ssim_source
from gsfw.studies.bench.limits import Limits, machine
from gsfw.studies.bench.rounds import Bench, Entrant

DIGITS = 6
"""Significant ones: clocks tell no more."""


def document(
    bench: Bench, repeats: int, pairs: int, limits: Limits | None, memory_mb: float | None
) -> dict[str, Any]:
    """Everything that was measured, as plain data.

    Args:
        bench: after its last round.
        repeats: rounds that count.
        pairs: contributing (pixel, splat) pairs of the workload.
        limits: of this machine, where they could be measured.
        memory_mb: peak of the process in all rounds, Python and torch included.
    """
    workload, cameras = bench.workload, bench.workload.cameras
    results = [
        _result(entrant, timings.figures(), bench, pairs, limits)
        for entrant, timings in bench.timings.items()
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
    entrant: Entrant,
    figures: Mapping[str, float],
    bench: Bench,
    pairs: int,
    limits: Limits | None,
) -> dict[str, Any]:
    """What one entrant took."""
    result: dict[str, Any] = {
        "rasterizer": entrant.rasterizer,
        "threads": entrant.threads,
        "details": dict(bench.details[entrant.rasterizer]),
    }
    result |= {name: _rounded(value) for name, value in figures.items()}
    peaks = bench.peaks[entrant]
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
    """How many times as long as the first entrant another took, by stage; medians by medians."""
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
