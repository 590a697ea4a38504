"""The compressed PLY: within half a step of every value, and as other tools write and read it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from plyfile import PlyData
from scipy.spatial import cKDTree
from support.refusals import refusal_of
from support.scenes import random_splats
from support.splat_transform import needs_splat_transform, splat_transform

from gsfw.core.exchange import SplatFile
from gsfw.core.splats import Sh
from gsfw.formats.compressed_ply import CompressedPlyExporter, CompressedPlyImporter
from gsfw.formats.morton_order import morton_order
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.formats.spz.importer import SpzImporter
from gsfw.formats.stored_rows import stored_parts

ROUNDING = 1e-5
"""Of values in float32, relative to them; the largest are about 20."""


def spread_splats(n, degree, seed=0):
    """Splats whose values lie all over their ranges."""
    chance = torch.Generator().manual_seed(seed)

    def normal(*shape):
        return torch.randn(*shape, generator=chance, dtype=torch.float64)

    return replace(
        random_splats(n, degree, dtype=torch.float64),
        means=10 * normal(n, 3),
        opacities=(3 * normal(n)).sigmoid(),
        quats=normal(n, 4),
        scales=(3 * normal(n, 3) - 4).exp(),
        colors=Sh(normal(n, (degree + 1) ** 2, 3), degree),
    )


def write(path, splats, **facts):
    CompressedPlyExporter().write(path, SplatFile(splats, **facts))
    return path


def read(path):
    return CompressedPlyImporter().read(path)


def stored(splats):
    return next(stored_parts(splats))


def check_within_half_steps(before, after):
    """Compare stored rows in the order of the file with the bounds that the module states."""
    chunk = np.arange(len(before)) // 256
    for name, steps, value in (
        ("means", [4094, 2046, 4094], lambda rows: rows.means),
        ("log-scales", [4094, 2046, 4094], lambda rows: rows.log_scales.clip(-20, 20)),
        ("colours", [510, 510, 510], lambda rows: rows.rgb),
    ):
        first, again = value(before), value(after)
        for number in range(chunk[-1] + 1):
            rows = chunk == number
            extent = np.ptp(first[rows], axis=0)
            limit = extent / steps + ROUNDING * (1 + np.abs(first[rows]).max())
            assert (np.abs(first - again)[rows] <= limit).all(), (name, number)
    assert np.abs(before.opacities - after.opacities).max() <= 1 / 510 + ROUNDING
    # With the three within e, the fourth, 1 / 2 or more, is within 3 e: 1 - cos <= (3 + 9) e^2 / 2.
    step = np.sqrt(2) / 2046
    assert (1 - np.abs((before.quats * after.quats).sum(axis=1))).max() <= 6.1 * step**2
    clipped = before.rest.clip(-4, 4)
    limit = np.where(np.abs(clipped) > 4 - 1 / 32, 1 / 32, 1 / 64) + ROUNDING
    assert (np.abs(clipped - after.rest) <= limit).all()


@pytest.mark.parametrize("degree", range(4))
def test_every_value_comes_back_within_half_a_step(tmp_path, degree):
    splats = spread_splats(600, degree)
    content = read(write(tmp_path / "a.compressed.ply", splats, antialiased=True, up="-y"))
    assert (content.antialiased, content.up, content.num_dropped) == (True, "-y", 0)
    assert content.splats.colors.degree == degree
    ordered = stored(splats.take(morton_order(splats.means)))
    check_within_half_steps(ordered, stored(content.splats))


@settings(max_examples=15)
@given(
    count=st.integers(1, 520),
    degree=st.integers(0, 3),
    seed=st.integers(0, 2**31),
    size=st.floats(1e-6, 1e6),
    place=st.floats(-1e5, 1e5),
)
def test_any_splats_come_back_within_half_a_step(
    tmp_path_factory, count, degree, seed, size, place
):
    splats = spread_splats(count, degree, seed)
    splats = replace(splats, means=size * splats.means + place)
    path = tmp_path_factory.mktemp("any") / "a.compressed.ply"
    content = read(write(path, splats))
    ordered = stored(splats.take(morton_order(splats.means)))
    check_within_half_steps(ordered, stored(content.splats))


def test_rewriting_changes_no_splat_beyond_rounding(tmp_path):
    once = read(write(tmp_path / "a.compressed.ply", spread_splats(300, 2))).splats
    twice = read(write(tmp_path / "b.compressed.ply", once)).splats
    first, second = stored(once.take(morton_order(once.means))), stored(twice)
    assert np.abs(first.rest - second.rest).max() < 1e-6
    assert np.abs(first.opacities - second.opacities).max() < 1e-6
    assert np.abs(first.rgb - second.rgb).max() < 1e-6


def test_opacities_and_scales_at_their_ends_are_kept(tmp_path):
    splats = random_splats(3, 0, dtype=torch.float64)
    splats = replace(
        splats,
        means=torch.arange(9.0, dtype=torch.float64).reshape(3, 3),
        opacities=torch.tensor([0.0, 0.5, 1.0], dtype=torch.float64),
        scales=torch.tensor([0.0, 1.0, 1e10], dtype=torch.float64)[:, None].expand(3, 3),
    )
    again = read(write(tmp_path / "a.compressed.ply", splats)).splats
    assert again.opacities.float().tolist() == pytest.approx([0, 128 / 255, 1])
    assert again.scales[:, 0].log().tolist() == pytest.approx([-20, 0, 20], abs=0.01)


def test_bands_above_degree_3_are_left_out(tmp_path):
    again = read(write(tmp_path / "a.compressed.ply", spread_splats(20, 4))).splats
    assert again.colors.degree == 3


def test_files_of_supersplat_are_read_and_written_again_in_their_layout(shared_data, tmp_path):
    source = shared_data / "splats" / "test_compressed_small.ply"
    content = read(source)
    assert (len(content.splats), content.splats.colors.degree) == (64, 3)
    path = write(tmp_path / "a.compressed.ply", content.splats)
    ours, theirs = PlyData.read(str(path)), PlyData.read(str(source))
    for element in theirs:
        same = next(item for item in ours if item.name == element.name)
        assert same.data.dtype == element.data.dtype
    large = read(shared_data / "splats" / "biker.compressed.ply")
    assert (len(large.splats), large.splats.colors.degree, large.num_dropped) == (152_746, 0, 0)


def test_chunks_of_12_numbers_have_colours_between_0_and_1(tmp_path):
    splats = spread_splats(300, 1)
    path = write(tmp_path / "a.compressed.ply", splats)
    data, raw = PlyData.read(str(path)), path.read_bytes()
    words = np.array(data["vertex"]["packed_color"])
    header, _, _ = raw.partition(b"end_header\n")
    lines = [line for line in header.split(b"\n") if not line.endswith((b"_r", b"_g", b"_b"))]
    chunks = np.stack([data["chunk"][name] for name in data["chunk"].data.dtype.names[:12]], axis=1)
    rest = raw[len(header) + len(b"end_header\n") + data["chunk"].count * 72 :]
    path.write_bytes(b"\n".join(lines) + b"end_header\n" + chunks.astype("<f4").tobytes() + rest)
    found = stored(read(path).splats)
    for column, shift in enumerate((24, 16, 8)):
        assert np.allclose(found.rgb[:, column], (words >> shift & 255) / 255, atol=1e-6)
    assert np.allclose(found.opacities, (words & 255) / 255, atol=1e-6)


refusal = refusal_of(read)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (b"max_x", b"max_u", "it has no element 'chunk' with max_x as float."),
        (b"max_b", b"max_u", "it has no element 'chunk' with max_b as float."),
        (b"uint packed_scale", b"int packed_scale", "it has no element 'vertex' with packed_scale"),
        (b"element chunk 2", b"element chunk 1", "announces 1 chunk rows, and 2 belong to its 300"),
        (b"element sh 300", b"element sh 299", "announces 299 sh rows, and 300 belong to its 300"),
        (b"uchar f_rest_4", b"char f_rest_4", "FILE: expected a uchar as f_rest_4."),
        (b"f_rest_8", b"f_rust_8", "FILE: 8 f_rest properties belong to no SH degree."),
        (b"element vertex 300", b"element vertex 0", "FILE contains no splats"),
        (b"element vertex 300", b"element vertex 999999999999", "a damaged PLY"),
    ],
)
def test_other_layouts_are_refused_with_what_is_wrong(tmp_path, before, after, message):
    path = write(tmp_path / "a.compressed.ply", spread_splats(300, 1))
    raw = path.read_bytes()
    assert before in raw
    path.write_bytes(raw.replace(before, after, 1))
    assert message in refusal(path)


def test_a_file_that_is_cut_short_is_refused_and_damaged_bounds_drop_their_rows(tmp_path):
    path = write(tmp_path / "a.compressed.ply", spread_splats(300, 1))
    raw = path.read_bytes()
    path.write_bytes(raw[:-1])
    assert refusal(path).startswith("FILE is cut short: its header announces 2 chunk, 300 vertex, ")
    start = raw.index(b"end_header\n") + len(b"end_header\n")
    for damage in (np.float32(np.nan).tobytes(), b"\1\0\x80\x7f"):  # Quiet and signalling.
        path.write_bytes(raw[:start] + damage + raw[start + 4 :])
        content = read(path)
        assert (content.num_dropped, len(content.splats)) == (256, 44)


def test_a_count_that_its_chunks_agree_with_is_refused_before_anything_is_reserved(tmp_path):
    path = write(tmp_path / "a.compressed.ply", spread_splats(300, 0))
    raw = path.read_bytes().replace(b"vertex 300", b"vertex 1000000000000")
    path.write_bytes(raw.replace(b"chunk 2", b"chunk 3906250000"))
    said = refusal(path)
    assert said.startswith("FILE is cut short: its header announces 3906250000 chunk, 10000000")


@needs_splat_transform
@pytest.mark.slow
@pytest.mark.parametrize("degree", [0, 3])
def test_splat_transform_reads_the_same_values(tmp_path, degree):
    splats = spread_splats(700, degree)
    path = write(tmp_path / "a.compressed.ply", splats)
    splat_transform(path, tmp_path / "b.ply")
    theirs, ours = stored(PlyImporter().read(tmp_path / "b.ply").splats), stored(read(path).splats)
    check_same_values(theirs, ours)


@needs_splat_transform
@pytest.mark.slow
def test_files_of_splat_transform_are_read_within_half_a_step(tmp_path):
    splats = spread_splats(700, 3)
    PlyExporter().write(tmp_path / "a.ply", SplatFile(splats))
    splat_transform(tmp_path / "a.ply", tmp_path / "b.compressed.ply")
    content = read(tmp_path / "b.compressed.ply")
    ours = read(write(tmp_path / "c.compressed.ply", splats))
    # Both lie along a Morton curve, each with its own bounds.
    nearest = torch.cdist(content.splats.means, ours.splats.means).argmin(dim=1)
    assert len(nearest.unique()) > 690
    splat_transform(tmp_path / "b.compressed.ply", tmp_path / "d.ply")
    theirs = PlyImporter().read(tmp_path / "d.ply")
    check_same_values(stored(theirs.splats), stored(content.splats))


def check_same_values(theirs, ours):
    """Compare decoded values with those of splat-transform; the ends of opacities are its own."""
    assert np.allclose(theirs.means, ours.means, rtol=1e-6, atol=1e-5)
    assert np.allclose(theirs.opacities, ours.opacities, atol=2e-6)
    assert np.allclose(theirs.log_scales, ours.log_scales, atol=2e-5)
    assert np.allclose(theirs.rgb, ours.rgb, atol=1e-5)
    assert np.allclose(theirs.rest, ours.rest, atol=1e-6)
    assert np.allclose(np.abs((theirs.quats * ours.quats).sum(axis=1)), 1, atol=1e-6)


@needs_splat_transform
@pytest.mark.slow
def test_biker_is_read_as_splat_transform_reads_it(shared_data, tmp_path):
    source = shared_data / "splats" / "biker.compressed.ply"
    splat_transform(source, tmp_path / "a.ply")
    theirs = PlyImporter().read(tmp_path / "a.ply")
    ours = read(source)
    # It writes an opacity of 1 as a logit of infinity.
    assert (len(theirs.splats), theirs.num_dropped) == (152_746, 0)
    check_same_values(*(next(stored_parts(item.splats, chunk=152_746)) for item in (theirs, ours)))


@pytest.mark.slow
def test_biker_holds_the_same_splats_as_biker_in_spz(shared_data):
    folder = shared_data / "splats"
    spz = SpzImporter().read(folder / "biker.spz").splats
    ours = read(folder / "biker.compressed.ply").splats
    assert len(spz) == len(ours)
    distances, nearest = cKDTree(spz.means.numpy()).query(ours.means.numpy())
    spz = spz.take(torch.from_numpy(nearest))
    # Half a step of SPZ: 2^-12 in position, 1 / 16 in log-scale, 1 / (255 * 0.15) in colour.
    assert distances.max() <= 3**0.5 * 2**-13 + 1e-5
    apart = {
        1 / 32: (spz.scales.log() - ours.scales.log()).abs(),
        1 / (2 * 255 * 0.15): (spz.colors.coefficients - ours.colors.coefficients).abs(),
        1 / 510: (spz.opacities - ours.opacities).abs(),
        1e-3: 1 - (spz.quats * ours.quats).sum(dim=1).abs(),
    }
    for limit, values in apart.items():
        # Some of the splats share a position with others.
        assert float((values > limit + 1e-4).double().mean()) < 0.01, limit
