"""The program that sanitizers watch, and what the GPU script makes of their findings."""

import os
from pathlib import Path

import gpu_kernels
import pytest
import torch
from gpu_session import Session
from support.calls import CountedLauncher
from support.gpu_sessions import on_a_gpu, parts, stand_in

from gsfw.kernels.cuda.catalogue import catalogue
from gsfw.kernels.cuda.operators import CudaOperators

CPU = torch.device("cpu")

FIELDS = {"plane_product.cu", "hash_features.cu", "grid_variation.cu", "slice.cu", "neighbors.cu"}

SEES_OVERRUNS = 'case "$*" in *overrun) echo "ERROR SUMMARY: 8 errors"; exit 9;; esac'
"""A line of a stand-in for compute-sanitizer."""


def test_the_program_that_sanitizers_watch_runs(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["gpu_kernels.py", "cpu"])
    assert gpu_kernels.main() == 0
    assert capsys.readouterr().out == "all kernels have run\n"


@pytest.mark.slow
def test_it_runs_every_kernel_of_fields():
    launcher = CountedLauncher()
    operators = CudaOperators(launcher)
    torch.stack(list(gpu_kernels.field_values(operators, CPU))).sum().backward()
    gpu_kernels.nearest(operators, CPU)
    expected = {kernel.expression for kernel, _ in catalogue() if kernel.source in FIELDS}
    assert expected <= set(launcher.launches)
    widths = {name for name in launcher.launches if name.startswith("neighbors<")}
    assert len(widths) == 2 * len(gpu_kernels.WIDTHS)


def watched(tmp_path: Path, *wanted: str) -> dict[str, dict]:
    """The report of a session in which sanitizers watch; their stand-ins need its PATH."""
    running: Session = on_a_gpu(tmp_path, *wanted)
    running._environment = dict(os.environ)
    running.sanitizers()
    return parts(tmp_path)


def test_sanitizers_that_are_not_there_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr("gpu_session.shutil.which", lambda name: None)
    assert {part["status"] for part in watched(tmp_path, "sanitizers").values()} == {"skipped"}


def test_a_sanitizer_that_finds_a_fault_fails(tmp_path, monkeypatch):
    summary = 'echo "========= ERROR SUMMARY: 1 error ($2)"'
    failing = '[ "$2" != racecheck ] || exit 9'
    stand_in(tmp_path, monkeypatch, "compute-sanitizer", SEES_OVERRUNS, summary, failing)
    found = watched(tmp_path, "memcheck", "racecheck")
    assert set(found) == {"memcheck", "racecheck"}
    assert found["memcheck"]["status"] == "ok"
    assert found["racecheck"]["status"] == "failed"
    assert found["racecheck"]["reason"].endswith("ERROR SUMMARY: 1 error (racecheck)")


def test_a_memcheck_that_does_not_see_a_planted_overrun_fails(tmp_path, monkeypatch):
    summary = 'echo "========= ERROR SUMMARY: 0 errors"'
    stand_in(tmp_path, monkeypatch, "compute-sanitizer", summary)
    found = watched(tmp_path, "memcheck")["memcheck"]
    assert found["status"] == "failed"
    assert "planted overrun" in found["reason"]


def test_every_tensor_of_a_watched_program_has_an_allocation_of_its_own(tmp_path, monkeypatch):
    told = '[ "$PYTORCH_NO_CUDA_MEMORY_CACHING" = 1 ] || exit 9'
    stand_in(tmp_path, monkeypatch, "compute-sanitizer", told, SEES_OVERRUNS)
    assert watched(tmp_path, "memcheck")["memcheck"]["status"] == "ok"
