"""Report: what every part found, as a table for people and a document for programs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gpu_profile import KernelProfile
from printing import say

FIGURES = {
    "forward": "forward",
    "frame": "frame, without gradients",
    "image": "forward + backward",
    "step": "training step, our loss and Adam in both",
    "sparse_step": "the same, Adam on visible rows only",
}
"""Stages of `gsfw bench`, in words."""

OWN_STEPS = {"own_step": ("step", "graph_step"), "own_sparse_step": ("sparse_step",)}
"""Steps as gsplat's own trainer does them, and the steps of ours that they are set against."""

GRAPH_STEP = {"graph_step": "training step, ours as a CUDA graph"}

LOG_LINES = 200
"""Last lines of each log that are kept."""

Row = tuple[str, str, str, str, str]
COLUMNS: Row = ("part", "figure", "ours", "other", "other / ours")


class Report:
    """Writes both files anew after each part, so that what comes later can lose nothing."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows: list[Row] = []
        self._notes: list[str] = []
        self._document: dict[str, Any] = {"parts": {}}
        self._machine = ""
        self._logs: dict[str, str] = {}
        self.failed = False

    def machine(self, found: Mapping[str, Any]) -> None:
        """Note what is measured on."""
        self._document["machine"] = dict(found)
        told = (f"{key} {value}" for key, value in found.items() if value and key != "seconds")
        self._machine = "; ".join(told)
        say(self._machine)
        self._write()

    def add(self, part: str, status: str, reason: str, seconds: float = 0.0) -> None:
        """Note how a part ended: ok, skipped or failed."""
        self.failed = self.failed or status == "failed"
        self._document["parts"][part] = {
            "status": status,
            "reason": reason,
            "seconds": round(seconds, 1),
        }
        self._notes.append(f"{part}: {status}: {reason}")
        say(self._notes[-1])
        self._write()

    def tests(
        self,
        part: str,
        counts: Mapping[str, int],
        left_out: int,
        seconds: float,
        problem: str,
    ) -> None:
        """Note how many tests passed."""
        bad = counts["FAILED"] + counts["ERROR"]
        told = f"{counts['PASSED']} passed, {bad} failed, {counts['SKIPPED']} skipped"
        if left_out:
            told += f", {left_out} left out"
        if problem:
            told += f" ({problem})"
        # Tests that the time did not suffice for are left out, which is no failure.
        status = "failed" if bad or not counts["PASSED"] or (problem and not left_out) else "ok"
        self._rows.append((part, told, "", "", ""))
        self.add(part, status, told, seconds)

    def drawing(self, part: str, found: dict[str, Any], alone: bool) -> None:
        """Take a document of `gsfw bench`; of one that ran ``alone`` speed is no figure."""
        self._rows += [] if alone else _drawing_rows(part, found)
        self._rows += _other_rows(part, found)
        self._take(part, found)

    def profile(
        self, part: str, kernels: Sequence[KernelProfile], problem: str, seconds: float
    ) -> None:
        """Take what counters say of each kernel, also where the time did not suffice for all."""
        for kernel in kernels:
            told = f"{kernel.name}: {kernel.launches} launches, {kernel.registers:.0f} registers, "
            told += f"{kernel.warps:.1f} warps, {kernel.issue:.0f} % issued, "
            told += f"{kernel.memory:.0f} % of memory, {kernel.instructions / 1e6:.2f} M "
            told += f"instructions, {kernel.bytes / 1e6:.2f} MB"
            self._rows.append((part, told, f"{kernel.microseconds:.1f} us", "", ""))
        if kernels:
            self._take(part, {"seconds": seconds, "kernels": [asdict(k) for k in kernels]})
        else:
            self.add(part, "failed", problem or "it printed no table", seconds)

    def training(self, part: str, found: dict[str, Any]) -> None:
        """Take the summary of a run."""
        psnr, memory = found.get("psnr"), found.get("peak_gpu_memory_mb")
        told = f"{found['steps']} steps, {found['num_gaussians']:,} Gaussians"
        if psnr is not None:
            told += f", PSNR {psnr:.2f} dB"
        if memory is not None:
            told += f", {memory:,.0f} MB"
        self._rows.append((part, told, f"{found['train_seconds']:.1f} s", "", ""))
        self._take(part, found)

    def log(self, part: str, file: Path) -> None:
        """Keep the end of what a part printed on standard error."""
        lines = file.read_text(encoding="utf-8", errors="replace").splitlines()
        self._logs[part] = "\n".join(lines[-LOG_LINES:])

    def show(self) -> None:
        """Print the table."""
        if self._rows:
            say("\n" + "\n".join(_aligned([COLUMNS, *self._rows])))
            say("\n".join(["", *self._notes]))
        say(f"\nalso in {self._folder}: gpu.md, gpu.json, gpu.log")

    def _take(self, part: str, found: dict[str, Any]) -> None:
        self._document["parts"][part] = {"status": "ok", **found}
        say(f"{part}: ok, {found['seconds']:.0f} s")
        self._write()

    def _write(self) -> None:
        table = [COLUMNS, ("---",) * len(COLUMNS), *self._rows]
        lines = ["| " + " | ".join(row) + " |" for row in table]
        notes = (f"* {note}" for note in self._notes)
        text = "\n".join([f"Machine: {self._machine}", "", *lines, "", *notes, ""])
        (self._folder / "gpu.md").write_text(text, encoding="utf-8")
        document = json.dumps(self._document, indent=1)
        (self._folder / "gpu.json").write_text(document, encoding="utf-8")
        logs = "\n".join(f"== {part}\n{text}" for part, text in self._logs.items())
        (self._folder / "gpu.log").write_text(logs, encoding="utf-8")


def _drawing_rows(part: str, found: Mapping[str, Any]) -> Iterator[Row]:
    """A line per figure, ours beside each other rasterizer."""
    workload, results = found["workload"], found["results"]
    ours = results[0]
    yield (
        part,
        f"{workload['description']}; {workload['pairs_per_pixel']:.0f} pairs per pixel",
        ours["rasterizer"],
        "",
        "",
    )
    for other in results[1:]:
        name = other["rasterizer"]
        for key, words in FIGURES.items():
            if f"{key}_ms" in other:
                yield _compared(part, f"{words}, {name}", ours, other, key, key)
        if "frame_ms" in other and "graph_frame_ms" in ours:
            words = f"frame, ours as a CUDA graph, {name}"
            yield _compared(part, words, ours, other, "graph_frame", "frame")
        for key, against in ((key, mine) for key, every in OWN_STEPS.items() for mine in every):
            if f"{key}_ms" in other and f"{against}_ms" in ours:
                words = f"{(FIGURES | GRAPH_STEP)[against]}: as gsplat's trainer does it (SSIM: "
                words += f"{found.get('own_step_ssim', 'unknown')})"
                yield _compared(part, words, ours, other, against, key)
        for key, whole in (("image", "an image"), ("step", "a step")):
            if f"{key}_peak_mb" in other:
                mine, its = ours[f"{key}_peak_mb"], other[f"{key}_peak_mb"]
                ratio = f"{its / mine:.2f}" if mine else ""
                yield part, f"memory of {whole}, {name}", f"{mine:,.0f} MB", f"{its:,.0f} MB", ratio
    yield from _stage_rows(part, ours)


def _compared(
    part: str,
    words: str,
    ours: Mapping[str, Any],
    other: Mapping[str, Any],
    mine: str,
    its: str,
) -> Row:
    ratio = other[f"{its}_ms"] / ours[f"{mine}_ms"] if ours[f"{mine}_ms"] else 0.0
    return part, words, _time(ours, mine), _time(other, its), f"{ratio:.2f}"


def _time(result: Mapping[str, Any], key: str) -> str:
    """The median, and the distance of the quartiles."""
    return f"{result[f'{key}_ms']:.3f} ± {result[f'{key}_spread_ms']:.3f} ms"


def _stage_rows(part: str, ours: Mapping[str, Any]) -> Iterator[Row]:
    stages = ("project", "sort", "bin", "blend", "blend_backward", "project_backward")
    told = [
        f"{stage.replace('_', ' ')} {ours[f'{stage}_ms']:.3f}"
        for stage in stages
        if f"{stage}_ms" in ours
    ]
    if told:
        yield part, f"stages in ms: {', '.join(told)}", "", "", ""


def _other_rows(part: str, found: Mapping[str, Any]) -> Iterator[Row]:
    """Errors, first use and sorting, where they were measured."""
    for name, scenes in found.get("agreement", {}).items():
        for scene, errors in scenes.items():
            gradients = {key: value for key, value in errors.items() if "gradient" in key}
            worst = max(gradients, key=lambda key: gradients[key])
            told = f"errors of {name}, {scene}: largest {errors['largest']:.1e}, image "
            told += f"{errors['image']:.1e}, {worst} {gradients[worst]:.1e}, "
            yield part, f"{told}{errors['flips']:.0f} flips", "", "", ""
    for name, states in found.get("first_use", {}).items():
        for state, seconds in states.items():
            told = ", ".join(
                f"{key.removesuffix('_seconds').replace('_', ' ')} {value:.2f}"
                for key, value in seconds.items()
            )
            yield part, f"{name}, {state} cache, seconds: {told}", "", "", ""
    for item in found.get("sorts", ()):
        ratio = item["torch_sort_ms"] / item["radix_sort_ms"]
        words = f"{item['keys']:,} keys of {item['bits']} bits, torch.sort"
        words += "" if item["same"] else ": OTHER ORDER"
        mine, its = (_time(item, sort) for sort in ("radix_sort", "torch_sort"))
        yield part, words, mine, its, f"{ratio:.2f}"


def _aligned(rows: list[Row]) -> Iterator[str]:
    widths = [max(len(row[column]) for row in rows) for column in range(len(COLUMNS))]
    for row in rows:
        cells = (f"{cell:{width}}" for cell, width in zip(row, widths, strict=True))
        yield "  ".join(cells).rstrip()
