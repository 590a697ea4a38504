"""Errors against the float64 reference are those that there are."""

import math
from dataclasses import replace

import pytest
import torch
from support.scenes import front_camera, random_splats

from gsfw.rasterizers.reference.rasterizer import ReferenceRasterizer
from gsfw.studies.bench import agreement as bench_agreement
from gsfw.studies.bench.agreement import agreement, agreement_at_random
from gsfw.studies.entrants import Entrant

CPU = torch.device("cpu")


class Off(ReferenceRasterizer):
    """Adds something to every image."""

    def __init__(self, error: float) -> None:
        super().__init__()
        self._error = error

    def _render(self, splats, cameras, settings):
        output = super()._render(splats, cameras, settings)
        return replace(output, color=output.color + self._error)


def entrant(rasterizer) -> Entrant:
    return Entrant("one", rasterizer, rasterizer.capabilities(), CPU)


def test_the_reference_in_float32_is_near_to_itself():
    errors = agreement(entrant(ReferenceRasterizer()), random_splats(20), front_camera(16, 12))
    assert {"image", "largest", "flips", "gradient of means", "gradient of pose"} <= errors.keys()
    assert all(error < 1e-4 for name, error in errors.items() if name != "flips")
    assert errors["flips"] == 0


def test_what_is_off_is_seen():
    errors = agreement(entrant(Off(0.5)), random_splats(20), front_camera(16, 12))
    assert errors["largest"] == pytest.approx(0.5, abs=1e-5)
    assert errors["flips"] == 16 * 12


def test_of_random_scenes_the_worst_counts_and_flips_add_up(monkeypatch):
    monkeypatch.setattr(bench_agreement, "RANDOM_SPLATS", 30)
    monkeypatch.setattr(bench_agreement, "RANDOM_SIZE", (8, 6))
    errors = agreement_at_random(entrant(Off(0.25)), 2, CPU)
    assert errors["largest"] == pytest.approx(0.25, abs=1e-5)
    assert errors["flips"] == 2 * 8 * 6


def test_what_is_not_a_number_is_not_hidden(monkeypatch):
    found = iter([{"image": 1.0}, {"image": math.nan}, {"image": 2.0}])
    monkeypatch.setattr(bench_agreement, "agreement", lambda *given: next(found))
    assert math.isnan(agreement_at_random(entrant(Off(0.0)), 3, CPU)["image"])
