"""Tests of exporter my-part."""

import csv

import pytest
import torch
from gsfw.api import Sh, SplatFile, Splats
from gsfw.testing import conformance

from my_part.exporter import MyPartExporter

test_conforms = conformance("exporter", "my-part")


def one_splat(x: float) -> SplatFile:
    means, scales = torch.tensor([[x, 2.0, 3.0]]), torch.full((1, 3), 0.1)
    quats, gray = torch.tensor([[2.0, 0.0, 0.0, 0.0]]), Sh(torch.zeros(1, 1, 3), 0)
    return SplatFile(Splats(means, torch.tensor([0.5]), gray, quats, scales))


def test_a_splat_is_a_line(tmp_path):
    MyPartExporter().write(tmp_path / "splats.csv", one_splat(1.0))
    (row,) = csv.DictReader((tmp_path / "splats.csv").open())
    assert (row["x"], row["qw"], row["opacity"], row["r"]) == ("1", "1", "0.5", "0.5")


def test_a_value_that_is_not_finite_is_named(tmp_path):
    with pytest.raises(ValueError, match="x of splat 0 is nan"):
        MyPartExporter().write(tmp_path / "splats.csv", one_splat(float("nan")))
