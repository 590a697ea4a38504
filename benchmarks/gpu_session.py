"""Session: runs the parts of a plan one after another, in the time that there is."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import shlex
import shutil
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomllib
from gpu_gsplat import Gsplat
from gpu_plan import Drawing, Plan
from gpu_process import Ended, Process
from gpu_profile import profiler, read_profile
from gpu_report import Report

ROOT = Path(__file__).resolve().parents[1]

WORKS_SECONDS = 60.0
TEST_SECONDS = 150.0
SANITIZER_SECONDS = 120.0
PROFILE_SECONDS = 60.0
SAFETY = 1.4
"""A training may take so much longer than a short one promises: it has more Gaussians."""

KERNELS = Path(__file__).with_name("gpu_kernels.py")
"""Runs the kernels on inputs that are small enough for a checker of memory."""

OUTCOME = re.compile(r"\b(PASSED|FAILED|ERROR|SKIPPED)\b")
SELECTED = re.compile(r"(\d+) selected|\[(\d+) items\]|collected (\d+) items")


class Session:
    """Everything that is run needs the same environment, and shares the time."""

    def __init__(
        self,
        plan: Plan,
        report: Report,
        environment: Mapping[str, str],
        work: Path,
        deadline: float,
        parts: tuple[str, ...],
    ) -> None:
        self._plan, self._report, self._environment = plan, report, environment
        self._work, self._deadline, self._parts = work, deadline, parts

    def left(self) -> float:
        """Seconds until the deadline."""
        return self._deadline - time.monotonic()

    def json(
        self,
        name: str,
        command: list[str],
        limit: float,
        environment: Mapping[str, str] | None = None,
    ) -> dict[str, Any]:
        """Run a command that prints a document; empty, with a line in the report, if it fails."""
        ended = self._run(name, command, limit, environment)
        if not ended.problem:
            try:
                found: dict[str, Any] = json.loads(ended.output[ended.output.index("{") :])
                return found | {"seconds": round(ended.seconds, 1)}
            except ValueError:
                self._report.add(name, "failed", "it printed no document")
                return {}
        self._report.add(name, "failed", ended.problem)
        return {}

    def skip_everything(self, reason: str) -> None:
        """Say of each part that it is not run."""
        names = ["tests", "gsplat", *self._plan.sanitizers]
        names += [drawing.name for drawing in self._plan.drawings]
        names += [f"training {scene}" for scene in self._plan.trainings]
        for name in (*names, *self._plan.missing):
            self._report.add(name, "skipped", reason)

    def wants_gsplat(self) -> bool:
        """True if a part that is run compares with it."""
        compared = [drawing.name for drawing in self._plan.drawings if not drawing.alone]
        return (
            "gsplat tests" in self._parts
            or any(self._wanted("drawings", name) for name in compared)
            or any(self._wanted("trainings", f"training {s}") for s in self._plan.trainings)
        )

    def works(self, command: list[str]) -> bool:
        """True if the self-test passes, without which nothing else is worth its time."""
        if not self._wanted("works", "works"):
            return True
        found = self.json("works", command, WORKS_SECONDS)
        if found:
            status = "failed" if found["fault"] else "ok"
            self._report.add("works", status, found["told"], found["seconds"])
        return bool(found) and not found["fault"]

    def tests(self) -> None:
        """The suites that hold for any rasterizer, on this device."""
        if self._wanted("tests", "tests"):
            self._test("tests", self._plan.tests, self._environment)

    def gsplat_tests(self, gsplat: Gsplat) -> None:
        """The tests of our adapter of gsplat, for which its kernels have to be compiled."""
        if self._wanted("tests", "gsplat tests"):
            self._test("gsplat tests", self._plan.gsplat_tests, gsplat.environment)

    def _test(self, name: str, arguments: Sequence[str], environment: Mapping[str, str]) -> None:
        command = [sys.executable, "-m", "pytest", "-v", "-p", "no:cacheprovider"]
        # Where pytest-benchmark lies about, it warns of pytest-xdist, which is an error here.
        command += [*arguments, "--color=no", "-p", "no:benchmark"]
        # Where this old package lies about, importing torch warns of it.
        command += ["-W", "ignore:The pynvml package:FutureWarning"]
        command += _workers(self._plan.device)
        ended = self._run(name, command, min(TEST_SECONDS, self.left()), environment)
        counts = {word: 0 for word in ("PASSED", "FAILED", "ERROR", "SKIPPED")}
        for line in ended.output.partition("short test summary")[0].splitlines():
            found = OUTCOME.search(line)
            if found:
                counts[found[1]] += 1
        sizes = [int(next(filter(None, found))) for found in SELECTED.findall(ended.output)]
        total = sizes[-1] if sizes else sum(counts.values())
        left_out = max(0, total - sum(counts.values()))
        self._report.tests(name, counts, left_out, ended.seconds, ended.problem)

    def sanitizers(self) -> None:
        """Let NVIDIA's checkers of memory, races and barriers watch the kernels."""
        tools = [tool for tool in self._plan.sanitizers if self._wanted("sanitizers", tool)]
        program = shutil.which("compute-sanitizer")
        for tool in tools:
            if program is None:
                self._report.add(tool, "skipped", "NVIDIA's compute-sanitizer is not there")
                continue
            ended = self._watched(program, tool, tool)
            summary = re.findall(r"ERROR SUMMARY: .*|RACECHECK SUMMARY: .*", ended.output)
            problem = ended.problem or (self._missed_overrun(program) if tool == "memcheck" else "")
            told = "; ".join(filter(None, [problem, *summary])) or "it found nothing"
            self._report.add(tool, "failed" if problem else "ok", told, ended.seconds)

    def _watched(self, program: str, tool: str, name: str, *arguments: str) -> Ended:
        """Run the kernels under one of NVIDIA's checkers."""
        command = [program, "--tool", tool, "--error-exitcode", "9"]
        # Those of torch would take most of the time.
        command += ["--kernel-name", "kns=gsfw", sys.executable, str(KERNELS), "cuda:0", *arguments]
        # torch's own allocator gives many tensors one allocation, in which no overrun is seen.
        environment = {**self._environment, "PYTORCH_NO_CUDA_MEMORY_CACHING": "1"}
        return self._run(name, command, min(SANITIZER_SECONDS, self.left()), environment)

    def _missed_overrun(self, program: str) -> str:
        """The fault to report if memcheck does not see a planted overrun; empty if it does."""
        planted = self._watched(program, "memcheck", "memcheck of an overrun", "overrun")
        seen = re.search(r"ERROR SUMMARY: [1-9]", planted.output)
        return "" if seen else "it does not see a planted overrun, so that it proves nothing"

    def profiles(self) -> None:
        """Counters of every kernel of some drawings, by NVIDIA's Nsight Compute."""
        program = shutil.which("ncu")
        for drawing in self._plan.drawings:
            name = f"profile {drawing.name}"
            if not drawing.profiled or not self._wanted("profiles", name):
                continue
            if program is None:
                self._report.add(name, "skipped", "NVIDIA's Nsight Compute (ncu) is not there")
                continue
            arguments = [*drawing.arguments, "repeats=1", "sparse=false"]
            command = [*profiler(program), *self._bench(self._plan.ours[:1]), *arguments]
            ended = self._run(name, command, min(PROFILE_SECONDS, self.left()))
            kernels = read_profile(ended.output)
            self._report.profile(name, kernels, ended.problem, ended.seconds)

    def wait_for(self, gsplats: list[Gsplat]) -> None:
        """Let what compiles beside the tests end, so that it does not disturb the measurements."""
        for gsplat in gsplats:
            seconds = gsplat.wait(self.left())
            status = "failed" if gsplat.problem else "ok"
            told = gsplat.problem or "its kernels are compiled"
            self._report.add(f"gsplat {gsplat.version}", status, told, seconds)

    def leave_out(self) -> None:
        """Say which parts cannot be run."""
        for name, reason in self._plan.missing.items():
            self._report.add(name, "skipped", reason)

    def drawings(self, gsplat: Gsplat | None, again: bool = False) -> None:
        """Speed, memory and errors, beside one gsplat where there is one.

        With ``again`` only what compares with it, as another one has been before.
        """
        for drawing in self._plan.drawings:
            if not self._wanted("drawings", drawing.name) or (again and drawing.alone):
                continue
            compared = None if drawing.alone else gsplat
            if not self._draw(drawing, compared) and compared and not again:
                self._draw(drawing, None)  # What failed may be gsplat: ours alone, then.

    def _draw(self, drawing: Drawing, gsplat: Gsplat | None) -> bool:
        """Measure one drawing; whether there is a result, or no time for one."""
        limit = min(drawing.limit, self.left())
        title = f"{drawing.name}, gsplat {gsplat.version}" if gsplat else drawing.name
        if limit < drawing.limit / 3:
            self._report.add(title, "skipped", "no time was left for it")
            return True
        rasterizers = self._plan.ours[: 1 if drawing.alone else None]
        rasterizers += ("gsplat",) if gsplat else ()
        command = [*self._bench(rasterizers), "json=true", *drawing.arguments]
        environment = gsplat.environment if gsplat else None
        found = self.json(title, command, limit, environment)
        if found:
            self._report.drawing(title, found, drawing.alone)
        return bool(found)

    def trainings(self, gsplat: Gsplat | None, steps: int) -> None:
        """Train with ours and with gsplat for as many steps as both have time for."""
        runners: dict[str, Mapping[str, str]] = {self._plan.ours[0]: self._environment}
        if gsplat:
            runners["gsplat"] = gsplat.environment
        scenes = {
            scene: settings
            for scene, settings in self._plan.trainings.items()
            if self._wanted("trainings", f"training {scene}")
        }
        for index, (scene, settings) in enumerate(scenes.items()):
            share = self.left() / (len(scenes) - index)
            chosen = self._choose_steps(scene, settings, runners, steps, share)
            for name, environment in runners.items() if chosen else ():
                title = f"training {scene}, {name}"
                found = self._train(title, settings, name, chosen, self.left(), environment)
                if found:
                    self._report.training(title, found)

    def _choose_steps(
        self,
        scene: str,
        settings: tuple[str, ...],
        runners: Mapping[str, Mapping[str, str]],
        steps: int,
        share: float,
    ) -> int:
        """Number of steps that fit for all runners, judged by short trainings; 0 if too few."""
        started, trial = time.monotonic(), self._plan.trial_steps
        per_step, around = 0.0, 0.0
        for name, environment in runners.items():
            title = f"training {scene}, {name}, trial"
            found = self._train(title, settings, name, trial, share / 2, environment)
            if not found:
                return 0
            per_step += found["train_seconds"] / trial
            around += found["seconds"] - found["train_seconds"]
        left = share - (time.monotonic() - started) - SAFETY * around
        fitting = int(left / (SAFETY * per_step))
        if fitting < self._plan.least_steps:
            self._report.add(
                f"training {scene}", "skipped", f"there was time for {max(fitting, 0)} steps only"
            )
            return 0
        if fitting >= steps:
            return steps
        return fitting - fitting % self._plan.least_steps

    def _train(
        self,
        title: str,
        settings: tuple[str, ...],
        rasterizer: str,
        steps: int,
        limit: float,
        environment: Mapping[str, str],
    ) -> dict[str, Any]:
        out = self._work / "runs" / re.sub(r"\W+", "-", title)
        shutil.rmtree(out, ignore_errors=True)
        command = [sys.executable, "-m", "gsfw", "train", "method=3dgs", *settings]
        command += [f"rasterizer={rasterizer}", f"device={self._plan.device}"]
        command += [f"steps={steps}", f"out={out}", "json=true"]
        return self.json(title, command, limit, environment)

    def _bench(self, rasterizers: Sequence[str]) -> list[str]:
        command = [sys.executable, "-m", "gsfw", "bench"]
        return [*command, f"rasterizer={','.join(rasterizers)}", f"device={self._plan.device}"]

    def _wanted(self, group: str, name: str) -> bool:
        return group in self._parts or name in self._parts

    def _run(
        self,
        name: str,
        command: list[str],
        limit: float,
        environment: Mapping[str, str] | None = None,
    ) -> Ended:
        file = re.sub(r"\W+", "-", name)
        process = Process(file, command, environment or self._environment, self._work)
        ended = process.wait(limit)
        self._report.log(name, self._work / f"{file}.log")
        return ended


def _workers(device: str) -> list[str]:
    """Options by which pytest takes all cores but two, and one where pytest-xdist is missing."""
    if importlib.util.find_spec("xdist"):
        workers = max(1, (os.cpu_count() or 1) - 2)
        # Few files have most of the tests, so that workers take them one by one.
        return ["-n", str(workers), "--dist", "worksteal"] if device == "cuda" else ["-n", "0"]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    options = project["tool"]["pytest"]["ini_options"]["addopts"]
    kept = [option for option in options if not option.startswith(("-n", "--dist"))]
    return ["-o", f"addopts={shlex.join(kept)}"]
