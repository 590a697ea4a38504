"""KSPLAT: all levels are read, levels 0 and 1 are written, and damage is one error."""

import struct
import subprocess
import tempfile
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.ksplat_files import records, sections
from support.refusals import refusal_of
from support.splat_files import alignment, largest, trained_splats
from support.splat_transform import needs_splat_transform, npm_install, splat_transform

from gsfw.core.errors import ConfigError
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.spherical_harmonics import C0
from gsfw.core.splats import Sh
from gsfw.formats.ksplat.buckets import BUCKET, buckets_of
from gsfw.formats.ksplat.exporter import KsplatExporter
from gsfw.formats.ksplat.importer import KsplatImporter
from gsfw.formats.ksplat.layout import MAIN_BYTES, RANGE, Section
from gsfw.formats.ply import PlyExporter, PlyImporter

COPY = "It may have been cut short or changed in copying; get it again."
HALF = 2.0**-11
"""Largest relative error of float16, down to 6.1e-5."""


def write(path, splats, level=1):
    KsplatExporter(level=level).write(path, SplatFile(splats))
    return path


def read(path):
    return KsplatImporter().read(path)


refusal = refusal_of(read)


def check_within_quantisation(given, again, level, block=5.0, half=HALF, byte=0.5):
    """Every value is as near as its number of bits allows; colours within those of a screen."""
    rounding = float(given.means.abs().max()) * 2.0**-23
    step = block / 2 / RANGE if level else 0.0
    assert largest(again.means, given.means) <= step / 2 + rounding
    assert largest(again.opacities, given.opacities) <= byte / 255 + 1e-6
    ratio = again.scales / given.scales
    assert largest(ratio, torch.ones_like(ratio)) <= (half if level else 0) + 1e-6
    # Four components, each off by at most ``half`` of itself.
    assert alignment(again.quats, given.quats) >= 1 - (half**2 / 2 if level else 0) - 1e-6
    before, after = given.colors.coefficients, again.colors.coefficients
    shown = before[:, 0].clamp(-0.5 / C0, 0.5 / C0)
    assert largest(after[:, 0], shown) <= byte / 255 / C0 + 1e-5
    wide = after.shape[1]
    error = (after[:, 1:] - before[:, 1:wide]).abs() - before[:, 1:wide].abs() * half * (level > 0)
    assert wide == 1 or float(error.max()) <= (2.0**-25 if level else 0) + 1e-9


@given(
    seed=st.integers(0, 2**31),
    degree=st.integers(0, 2),
    level=st.integers(0, 1),
    n=st.integers(1, 600),
)
@settings(max_examples=30)
def test_what_is_read_back_differs_by_the_quantisation_alone(
    tmp_path_factory, seed, degree, level, n
):
    path = tmp_path_factory.getbasetemp() / "again.ksplat"
    splats = trained_splats(n, degree, seed)
    again = read(write(path, splats, level))
    block = Section.read(path.read_bytes()[MAIN_BYTES:]).block
    assert block <= 5
    order = buckets_of(splats.means, block).order if level else torch.arange(n)
    assert torch.equal(order.sort().values, torch.arange(n))
    check_within_quantisation(splats.take(order), again.splats, level, block)
    assert again.properties == {"level": str(level), "sections": "1"}
    assert not again.antialiased
    assert again.up == ""
    first = path.read_bytes()
    assert write(path, splats, level).read_bytes() == first


def test_buckets_hold_splats_of_one_block_each():
    splats = trained_splats(3000, 0)
    buckets = buckets_of(splats.means, 5.0)
    assert int(buckets.lengths.sum()) == 3000
    assert buckets.full > 3
    assert (buckets.lengths[: buckets.full] == BUCKET).all()
    assert (buckets.lengths[buckets.full :] < BUCKET).all()
    offsets = splats.means[buckets.order] - torch.from_numpy(
        buckets.centers.repeat(buckets.lengths, axis=0)
    )
    assert float(offsets.abs().max()) <= 2.5 + 1e-5


def test_bands_above_the_second_are_left_out(tmp_path):
    assert read(write(tmp_path / "a.ksplat", trained_splats(9, 3))).splats.colors.degree == 2


def test_blocks_shrink_with_the_splats(tmp_path):
    # An object of a centimetre: with blocks of 5 its positions would have 130 different values.
    splats = trained_splats(500, 0, extent=0.01)
    again = read(write(tmp_path / "a.ksplat", splats)).splats
    block = Section.read((tmp_path / "a.ksplat").read_bytes()[MAIN_BYTES:]).block
    assert block / 2 / RANGE <= float(splats.scales.median()) / 8 * 1.001
    order = buckets_of(splats.means, block).order
    assert largest(again.means, splats.means[order]) <= block / 4 / RANGE + 1e-9


def test_a_file_of_another_writer_is_read(shared_data):
    path = shared_data / "splats" / "fixtures" / "minimal.ksplat"
    assert KsplatImporter.recognises(path)
    splats = read(path).splats
    assert splats.means.tolist() == [[-1, 0, -1], [0, 0, -1], [-1, 0, 0], [0, 0, 0]]
    assert torch.allclose(splats.scales, torch.tensor(0.1).double())
    assert torch.allclose(splats.opacities, torch.tensor(230 / 255).double())
    rgb = torch.tensor([0xAA, 0x55, 0x80]) / 255
    assert largest(splats.colors.coefficients[1, 0], (rgb - 0.5) / C0) < 1e-6


def test_sections_of_several_degrees_and_buckets_are_joined(tmp_path):
    first = (0, 2, 2, [1], [[1, 1, 1], [2, 2, 2], [3, 3, 3]], records(2, 0, 5))
    second = (3, 256, 0, [2, 1], [[7, 7, 7], [8, 8, 8]], records(2, 3, 3))
    (tmp_path / "a.ksplat").write_bytes(sections(2, [first, second]))
    splats = read(tmp_path / "a.ksplat").splats
    centers = np.array([1, 1, 2, 2, 3, 7, 7, 8])
    steps = np.array([0, 1, 2, 3, 4, 0, 1, 2]) * 1000 * 2.0 / RANGE
    assert np.allclose(splats.means[:, 0], steps + centers)
    assert np.allclose(splats.means[:, 1], centers)
    assert splats.colors.degree == 3
    rest = splats.colors.coefficients[:, 1:]
    assert not rest[:5].any()
    # Bytes 0 to 255 are 1 to 2, by the main header; bands are channel by channel.
    value = rest[5] - 1
    assert np.allclose(value[:3] * 255, np.arange(9).reshape(3, 3).T, atol=1e-4)
    assert np.allclose(value[3:8] * 255, np.arange(9, 24).reshape(3, 5).T, atol=1e-4)
    assert np.allclose(value[8:] * 255, np.arange(24, 45).reshape(3, 7).T, atol=1e-4)


class CountingBytes(bytes):
    """Bytes that count those copied by slices."""

    copied = 0

    def __getitem__(self, key):
        part = super().__getitem__(key)
        self.copied += len(part) if isinstance(key, slice) else 0
        return part


def test_many_sections_cost_no_more_than_the_length_of_the_file(tmp_path, monkeypatch):
    none = (0, 256, 0, [], np.zeros((0, 3)), records(1, 0, 0))
    one = (0, 256, 0, [1], [[1, 1, 1]], records(1, 0, 1))
    raw = CountingBytes(sections(1, [*[none] * 200, one]))
    monkeypatch.setattr(Path, "read_bytes", lambda path: raw)
    assert len(read(tmp_path / "a.ksplat").splats) == 1
    assert raw.copied < 2 * len(raw)


def test_buckets_that_do_not_cover_the_splats_are_refused(tmp_path):
    for size, full, partial in ((2, 2, [2]), (2, 2**31, [1]), (256, 0, [4]), (2**31, 1, [2**31])):
        centers = [[0, 0, 0]] * min(full + len(partial), 3)
        part = (0, size, full, partial, centers, records(1, 0, 5))
        (tmp_path / "a.ksplat").write_bytes(sections(1, [part]))
        said = refusal(tmp_path / "a.ksplat")
        assert "the buckets of a section hold" in said or "is cut short" in said


def test_files_of_another_kind_are_refused(tmp_path):
    path = tmp_path / "a.ksplat"
    assert refusal(path) == "FILE cannot be read: No such file or directory."
    assert not KsplatImporter.recognises(path)
    for content in (b"", b"ply\n", bytes(5000), b"\0\1\0\0" + b"\xff" * 5000, b"\0\1" + bytes(99)):
        path.write_bytes(content)
        assert "FILE " in refusal(path)
        assert not KsplatImporter.recognises(path)


def test_announcements_beyond_the_file_are_refused_without_a_large_allocation(tmp_path):
    path = write(tmp_path / "a.ksplat", trained_splats(600, 1))
    raw = path.read_bytes()
    tracemalloc.start()
    for place in (4, MAIN_BYTES, MAIN_BYTES + 4, MAIN_BYTES + 12, MAIN_BYTES + 32, MAIN_BYTES + 36):
        changed = bytearray(raw)
        changed[place : place + 4] = struct.pack("<I", 2**31)
        path.write_bytes(changed)
        assert "FILE is " in refusal(path)
    path.write_bytes(raw[:-1])
    assert refusal(path) == (
        f"FILE is cut short: section 1 announces 600 splats, up to byte {len(raw)}, and the file "
        f"has {len(raw) - 1}.\n{COPY}"
    )
    assert tracemalloc.get_traced_memory()[1] < 2_000_000
    tracemalloc.stop()


@pytest.mark.unchecked
def test_only_levels_0_and_1_are_written():
    with pytest.raises(ConfigError) as caught:
        KsplatExporter(level=2)
    assert str(caught.value) == (
        "format.level=2: KSPLAT is written in level 0 or 1.\n"
        "Leave it out for 1. For smaller files: format=spz or format=sog."
    )


def test_splats_that_cannot_be_stored_are_refused_and_nothing_is_written(tmp_path):
    splats = trained_splats(5, 1)
    large = replace(splats, scales=splats.scales + 1e5)
    with pytest.raises(ValueError, match=r"scales: the largest is 100000, and float16 ends at"):
        write(tmp_path / "a.ksplat", large)
    assert float(read(write(tmp_path / "b.ksplat", large, 0)).splats.scales.max()) > 1e5
    with pytest.raises(ValueError, match="with SH colours"):
        write(tmp_path / "a.ksplat", replace(splats, colors=torch.zeros(5, 3).double()))
    assert not (tmp_path / "a.ksplat").exists()


@pytest.mark.parametrize("level", [0, 1])
def test_positions_beyond_float32_are_refused_as_by_other_formats(tmp_path, level):
    splats = trained_splats(5, 1)
    splats.means[3, 2] = 1e39
    with pytest.raises(ValueError, match=r"means: row 3 is .*, 1e\+39, which a file cannot hold"):
        write(tmp_path / "a.ksplat", splats, level)


def test_colours_beyond_float16_are_stored_as_its_ends(tmp_path):
    splats = trained_splats(5, 1)
    splats.colors.coefficients[2, 1:] = torch.tensor([-1e9, 1.0, 1e9])
    found = read(write(tmp_path / "a.ksplat", splats))
    assert found.num_dropped == 0
    assert (found.splats.colors.coefficients[:, 1:].abs().amax(dim=(1, 2)) == 65504).sum() == 1


ORIGINAL = """
import fs from 'fs';
globalThis.window = globalThis; globalThis.self = globalThis;
globalThis.document = {createElement() { return {style: {}, appendChild() {}} },
                       createElementNS() { return {style: {}} }};
try { Object.defineProperty(globalThis, 'navigator', {value: {userAgent: 'node'},
                                                     configurable: true}) } catch (e) {}
const G = await import('@mkkellogg/gaussian-splats-3d');
const [source, level, degree, target] = process.argv.slice(2);
const data = fs.readFileSync(source);
const buffer = data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
const parsed = G.PlyParser.parseToUncompressedSplatArray(buffer, Number(degree));
const makeGenerator = G.SplatBufferGenerator.getStandardGenerator;
const generator = makeGenerator(1, Number(level), 0, undefined, 5, 256);
const result = generator.generateFromUncompressedSplatArray(parsed);
fs.writeFileSync(target, Buffer.from(result.bufferData));
"""


@pytest.mark.slow
@needs_splat_transform
@pytest.mark.parametrize(("level", "degree"), [(0, 2), (1, 0), (1, 2), (2, 1), (2, 2)])
def test_what_the_original_writes_is_read(tmp_path, level, degree):
    folder = Path(tempfile.gettempdir()) / "gsfw-gaussian-splats-3d-0.4.7"
    npm_install(folder, "@mkkellogg/gaussian-splats-3d@0.4.7", "three@0.160.0")
    splats = replace(trained_splats(3000, 2), opacities=torch.full((3000,), 0.75).double())
    PlyExporter().write(tmp_path / "a.ply", SplatFile(splats))
    (folder / "write.mjs").write_text(ORIGINAL)
    target = tmp_path / "a.ksplat"
    command = ["node", "write.mjs", str(tmp_path / "a.ply"), str(level), str(degree), str(target)]
    subprocess.run(command, cwd=folder, check=True, timeout=120)
    again = read(target).splats
    # The order is that of its buckets: splats are told apart by their places.
    distance = torch.cdist(again.means, splats.means)
    order = distance.argmin(dim=1)
    assert torch.equal(order.sort().values, torch.arange(3000))
    kept = Sh(splats.colors.coefficients[order, : (degree + 1) ** 2], degree)
    expected = replace(splats.take(order), colors=kept)
    rounding = {"half": 2 * HALF, "byte": 1.0}  # It cuts off.
    if level < 2:
        check_within_quantisation(expected, again, level, **rounding)
        return
    before, after = kept.coefficients, again.colors.coefficients
    bare = replace(again, colors=Sh(after[:, :1], 0))
    expected = replace(expected, colors=Sh(before[:, :1], 0))
    check_within_quantisation(expected, bare, level, **rounding)
    step = float(before[:, 1:].max() - before[:, 1:].min()) / 255
    assert largest(after[:, 1:], before[:, 1:]) <= 1.01 * step


@pytest.mark.slow
@needs_splat_transform
@pytest.mark.parametrize("level", [0, 1])
def test_another_tool_reads_what_is_written(tmp_path, level):
    splats = trained_splats(3000, 2)
    path = write(tmp_path / "a.ksplat", splats, level)
    splat_transform(path, tmp_path / "a.ply")
    other, ours = PlyImporter().read(tmp_path / "a.ply").splats, read(path).splats
    for name in ("means", "opacities", "colors"):
        assert largest(other.tensors()[name], ours.tensors()[name]) < 1e-5, name
    assert largest(other.scales / ours.scales, torch.ones_like(ours.scales)) < 1e-5
    assert alignment(other.quats, ours.quats) > 1 - 1e-6
