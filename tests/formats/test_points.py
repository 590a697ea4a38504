"""Points: positions and colours of splats, as other programs read them."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from plyfile import PlyData
from support.scenes import random_splats

from gsfw.core.errors import ConfigError, DataError
from gsfw.core.exchange import SplatFile
from gsfw.core.splats import Sh
from gsfw.datamanagers.point_file import read_points
from gsfw.formats.ply import PlyImporter
from gsfw.formats.points import PointsExporter
from gsfw.plugins.exporters import make_exporter
from gsfw.plugins.registry import installed

SPLATS = random_splats(30, 2, dtype=torch.float64)


def write(path, splats=SPLATS, **options):
    PointsExporter(**options).write(path, SplatFile(splats))
    return path


def test_points_have_the_places_and_colours_of_the_splats(tmp_path):
    path = write(tmp_path / "a.points.ply")
    rows = PlyData.read(str(path))["vertex"].data
    names = ("x", "y", "z", "red", "green", "blue")
    assert [(name, rows.dtype[name].str) for name in rows.dtype.names] == [
        *((name, "<f4") for name in names[:3]),
        *((name, "|u1") for name in names[3:]),
    ]
    points, colors = read_points(path, "it")
    assert torch.equal(points, SPLATS.means.float().double())
    expected = 0.5 + 0.28209479177387814 * SPLATS.colors.coefficients[:, 0]
    assert float((colors - expected).abs().max()) <= 1 / 510 + 1e-6


def test_colours_beyond_the_range_are_clamped(tmp_path):
    bright = Sh(torch.full((30, 1, 3), 9.0) * torch.tensor([1.0, -1.0, 0.0]), 0)
    rows = PlyData.read(str(write(tmp_path / "a.ply", replace(SPLATS, colors=bright))))["vertex"]
    assert (rows["red"][0], rows["green"][0], rows["blue"][0]) == (255, 0, 128)


def test_faint_splats_can_be_left_out(tmp_path):
    rows = PlyData.read(str(write(tmp_path / "a.ply", min_opacity=0.5)))["vertex"]
    opaque = SPLATS.means[SPLATS.opacities >= 0.5].float()
    assert 0 < len(opaque) < 30
    assert np.array_equal(np.stack([rows[axis] for axis in "xyz"], axis=1), opaque)
    with pytest.raises(ValueError, match="no splat has an opacity of 1 or more"):
        write(tmp_path / "b.ply", min_opacity=1.0)
    with pytest.raises(ConfigError, match=r"min_opacity=1\.5: expected a number from 0 to 1\."):
        make_exporter("points", installed(), {"min_opacity": 1.5})
    broken = replace(SPLATS, opacities=SPLATS.opacities.index_fill(0, torch.tensor(4), torch.nan))
    with pytest.raises(ValueError, match="opacities: row 4 is nan"):
        write(tmp_path / "b.ply", broken, min_opacity=0.5)
    assert not (tmp_path / "b.ply").exists()


def test_points_are_not_taken_for_splats(tmp_path):
    with pytest.raises(DataError, match="holds points or a mesh, not splats"):
        PlyImporter().read(write(tmp_path / "a.points.ply"))
