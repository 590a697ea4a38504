"""Values that formats store: parts, mirrored frames, activation."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.rotations import unit_matrices
from gsfw.core.maths.similarity import Similarity
from gsfw.core.splats import Sh
from gsfw.formats.morton_order import morton_order
from gsfw.formats.smallest_three import from_smallest_three, smallest_three
from gsfw.formats.stored_rows import (
    RDF_TO_LUF,
    RDF_TO_RUB,
    StoredRows,
    activated,
    gathered,
    stored_parts,
)
from gsfw.plugins.exporters import make_exporter
from gsfw.plugins.registry import installed
from gsfw.studies.stress.case import random_splats
from gsfw.testing.sources import splat_file

SPLAT_FORMATS = ("ply", "compressed-ply", "splat", "splatv", "spz", "ksplat", "gltf", "sog", "html")


def whole(splats):
    return next(stored_parts(splats))


def covariances(rows):
    axes = unit_matrices(torch.from_numpy(rows.quats)).numpy() * np.exp(rows.log_scales)[:, None]
    return axes @ axes.transpose(0, 2, 1)


def test_parts_in_an_order_are_rows_of_the_whole():
    splats = random_splats(50, 2, dtype=torch.float64)
    order = torch.randperm(50, generator=torch.Generator().manual_seed(0))
    parts = list(stored_parts(splats, order, chunk=16))
    assert [len(part) for part in parts] == [16, 16, 16, 2]
    joined = StoredRows(
        *(
            np.concatenate([getattr(part, name) for part in parts])
            for name in StoredRows.__dataclass_fields__
        )
    )
    expected = whole(splats).take(order.numpy())
    for name in StoredRows.__dataclass_fields__:
        assert np.array_equal(getattr(joined, name), getattr(expected, name)), name


@pytest.mark.parametrize("name", SPLAT_FORMATS)
def test_no_format_writes_a_file_of_no_splats(tmp_path, name):
    exporter = make_exporter(name, installed())
    none = splat_file().splats.take(torch.arange(0))
    path = tmp_path / f"a{exporter.suffix}"
    with pytest.raises(ValueError, match="there are no splats"):
        exporter.write(path, replace(splat_file(), splats=none))
    assert not path.exists()


@pytest.mark.parametrize("name", sorted(set(SPLAT_FORMATS) - {"splatv"}))
@pytest.mark.parametrize(
    ("field", "value"),
    [
        *((field, math.nan) for field in ("means", "scales", "quats", "opacities", "colors")),
        ("scales", math.inf),
        ("scales", -1.0),
        ("opacities", -0.1),
        ("opacities", 1.5),
    ],
)
def test_no_format_writes_values_that_a_file_cannot_hold(tmp_path, name, field, value):
    """Format splatv has bounds of its own."""
    exporter, splats = make_exporter(name, installed()), splat_file(5, 1).splats
    values = splats.tensors()[field].clone()
    values[3].view(-1)[-1] = value
    broken = replace(splats, **{field: Sh(values, 1) if field == "colors" else values})
    path = tmp_path / f"a{exporter.suffix}"
    message = rf"^{field}: row 3 is .*{value:g}, which a file cannot hold \(1 such rows\)$"
    with pytest.raises(ValueError, match=message):
        exporter.write(path, replace(splat_file(), splats=broken))
    assert list(tmp_path.iterdir()) == []


def test_numbers_beyond_float32_are_refused():
    splats = random_splats(5, 0, dtype=torch.float64)
    splats.means[0, 2] = 1e39
    with pytest.raises(ValueError, match=r"means: row 0 is .*, 1e\+39, which a file cannot hold"):
        whole(splats)


def test_stored_values_are_activated_to_the_same_splats():
    splats = random_splats(50, 3, dtype=torch.float64)
    again, dropped = activated(Path("a"), whole(splats))
    assert dropped == 0
    for name, tensor in again.tensors().items():
        given = splats.tensors()[name].double()
        if name == "quats":
            given = given / given.norm(dim=1, keepdim=True)
        assert torch.allclose(tensor.double(), given, rtol=2e-6, atol=2e-7), name


def test_parts_of_a_file_are_gathered_without_rows_that_are_not_finite():
    splats = random_splats(50, 2, dtype=torch.float64)
    rows = whole(splats)
    rows.means[3], rows.means[4] = np.nan, 1e39
    rows.logits[20], rows.log_scales[21, 2], rows.log_scales[22, 1] = np.nan, np.inf, 89
    rows.quats[48], rows.rest[49, 7, 2] = np.nan, np.inf
    rows.logits[7], rows.logits[8], rows.log_scales[9] = np.inf, -np.inf, -np.inf
    bad = [3, 4, 20, 21, 22, 48, 49]
    parts = (rows.take(slice(first, first + 16)) for first in range(0, 50, 16))
    found, dropped = gathered(Path("a"), 50, 2, parts)
    again, _ = activated(Path("a"), rows)
    good = torch.tensor([row for row in range(50) if row not in bad])
    assert (dropped, len(found)) == (len(bad), len(good))
    for name, tensor in found.tensors().items():
        assert torch.equal(tensor, again.tensors()[name]), name
    assert torch.equal(found.means, splats.means[good])
    assert found.opacities.float()[torch.isin(good, torch.tensor([7, 8]))].tolist() == [1, 0]
    assert not found.scales.float()[good == 9].any()


def test_mirrored_axes_are_a_rotation_of_the_scene():
    splats = random_splats(20, 4, dtype=torch.float64)
    for signs in (RDF_TO_RUB, RDF_TO_LUF):
        turn = Similarity(rotation=torch.diag(torch.tensor(signs, dtype=torch.float64)))
        expected = whole(transform_splats(splats, turn))
        mirrored = whole(splats).mirrored(signs)
        assert np.allclose(mirrored.means, expected.means)
        assert np.allclose(mirrored.rest, expected.rest, atol=1e-5)
        assert np.allclose(covariances(mirrored), covariances(expected), atol=1e-6)
        again = mirrored.mirrored(signs)
        assert np.array_equal(again.rest, whole(splats).rest)


def test_the_smallest_three_give_the_quaternion_back():
    quats = np.random.default_rng(0).normal(size=(1000, 4))
    quats /= np.linalg.norm(quats, axis=1, keepdims=True)
    largest, three = smallest_three(quats)
    again = from_smallest_three(largest, three)
    assert np.abs(np.abs((again * quats).sum(axis=1)) - 1).max() < 1e-12
    assert (again[np.arange(1000), largest] > 0).all()
    # Components that are too long, as damaged files have them, still give unit quaternions.
    damaged = from_smallest_three(largest, np.ones((1000, 3)))
    assert np.allclose(np.linalg.norm(damaged, axis=1), 1)


def test_the_morton_order_visits_the_octants_one_after_the_other():
    corners = torch.tensor([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)]).double()
    shuffled = torch.randperm(8, generator=torch.Generator().manual_seed(1))
    assert torch.equal(shuffled[morton_order(corners[shuffled])], torch.arange(8))
    points = torch.rand(4096, 3, generator=torch.Generator().manual_seed(0)).double()
    along = points[morton_order(points)].diff(dim=0).norm(dim=1).mean()
    assert along < 0.2 * points.diff(dim=0).norm(dim=1).mean()
    assert len(morton_order(points[:1])) == 1


def test_signalling_nans_are_mirrored_without_a_warning():
    rows = whole(random_splats(3, 0, dtype=torch.float64))
    rows.means.view(np.uint64)[1, 0] = 0x7FF0000000000001
    assert np.isnan(rows.mirrored(RDF_TO_RUB).means[1, 0])
