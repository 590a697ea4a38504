"""PLY files of points."""

import numpy as np
import pytest
import torch
from plyfile import PlyData, PlyElement

from gsfw.core.errors import DataError
from gsfw.datamanagers.point_file import read_points


def write(path, rows, names="xyz"):
    points = np.array(rows, dtype=[(name, "f4") for name in names])
    PlyData([PlyElement.describe(points, "vertex")]).write(path)
    return path


def test_points_without_colours_are_grey(tmp_path):
    points, colors = read_points(write(tmp_path / "a.ply", [(1, 2, 3)]), "it")
    assert points.tolist() == [[1.0, 2.0, 3.0]]
    assert colors.tolist() == [[0.5, 0.5, 0.5]]


def test_colours_in_floating_point_stay_as_they_are(tmp_path):
    names = ("x", "y", "z", "red", "green", "blue")
    _, colors = read_points(write(tmp_path / "a.ply", [(1, 2, 3, 0.25, 0.5, 2.0)], names), "it")
    torch.testing.assert_close(colors, torch.tensor([[0.25, 0.5, 1.0]]))


def test_points_that_are_not_finite_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"a\.ply: some of its points are not finite"):
        read_points(write(tmp_path / "a.ply", [(1, np.inf, 3)]), "it")


def test_a_file_without_points_is_refused(tmp_path):
    with pytest.raises(DataError, match=r"a\.ply does not hold points: .*\n.*remove ply_file to t"):
        read_points(write(tmp_path / "a.ply", [(1, 2)], "xy"), "ply_file")
