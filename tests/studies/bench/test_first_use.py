"""What a new process takes to its first image is measured in new processes."""

import subprocess

import pytest

from gsfw.core.errors import UnavailableError
from gsfw.kernels.cpu.native_module import native
from gsfw.studies.bench import first_use as bench_first_use
from gsfw.studies.bench.first_use import first_use


@pytest.mark.slow
def test_each_part_is_measured_with_an_empty_and_a_filled_cache():
    found = first_use("cpu" if native() is not None else "reference", "cpu")
    assert list(found) == ["cold", "warm"]
    for seconds in found.values():
        assert list(seconds) == [
            "torch_seconds",
            "gsfw_seconds",
            "first_image_seconds",
            "first_backward_seconds",
        ]
        assert all(value >= 0.0 for value in seconds.values())


def test_a_process_that_fails_says_why(monkeypatch):
    monkeypatch.setattr(bench_first_use, "CHILD", "raise SystemExit('no luck')")
    with pytest.raises(UnavailableError) as refused:
        first_use("reference", "cpu")
    assert refused.value.message == (
        "a new process did not render with rasterizer reference: no luck"
    )
    assert refused.value.advice == "Leave first_use out, or see gsfw doctor."


def test_a_process_that_takes_too_long_is_ended(monkeypatch):
    def late(command, **given):
        raise subprocess.TimeoutExpired(command, given["timeout"])

    monkeypatch.setattr(subprocess, "run", late)
    with pytest.raises(UnavailableError, match="reference within 120 s"):
        first_use("reference", "cpu")
