"""Rounds: what they measure, and on which stream."""

from contextlib import contextmanager
from types import SimpleNamespace

import torch

from gsfw.plugins.registry import installed
from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.bench import rounds
from gsfw.studies.bench.rounds import Bench
from gsfw.studies.bench.workload import Workload, scattered
from gsfw.studies.entrants import Entrant


def test_the_trainer_of_an_entrant_is_on_the_default_stream(monkeypatch):
    found = []

    @contextmanager
    def stream(device):
        found.append("begin")
        yield
        found.append("end")

    monkeypatch.setattr(rounds, "on_default_stream", stream)
    workload = Workload("small", *scattered(20, 20, 12, torch.device("cpu")))
    rasterizer = ReferenceRasterizer()
    entrant = Entrant("plain", rasterizer, rasterizer.capabilities(), torch.device("cpu"))
    bench = Bench(workload, [entrant], [1], installed())
    bench._own_steps = {"plain": {"own_step": SimpleNamespace(run=lambda: found.append("step"))}}
    bench.round()
    assert found == ["begin", "step", "end"]
    (timings,) = bench.timings.values()
    assert "own_step_ms" in timings.figures()
