"""SPZ: written as the official encoder does, read in every version, and damage is one error."""

import gzip
import math
import struct
import tracemalloc
import zlib
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from support.refusals import refusal_of
from support.scenes import random_splats
from support.splat_files import alignment, largest, trained_splats
from support.spz_files import check_within_quantisation, read, write

from gsfw.core.errors import ConfigError, OutputError, UnavailableError
from gsfw.core.exchange import SplatFile
from gsfw.core.maths.frame import transform_splats
from gsfw.core.maths.similarity import Similarity
from gsfw.core.splats import Sh
from gsfw.formats.spz.exporter import SpzExporter
from gsfw.formats.spz.importer import SpzImporter
from gsfw.formats.spz.quantisation import packed_bands, unpacked
from gsfw.formats.spz.streams import read_streams

COPY = "It may have been cut short or changed in copying; get it again."
VERSIONS = (2, 3, 4)


refusal = refusal_of(read)


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**31),
    degree=st.integers(0, 3),
    version=st.sampled_from(VERSIONS),
    sh_bits=st.integers(4, 8),
    antialiased=st.booleans(),
)
@settings(max_examples=40)
def test_what_is_read_back_differs_by_the_quantisation_alone(
    tmp_path_factory, seed, degree, version, sh_bits, antialiased
):
    path = tmp_path_factory.getbasetemp() / "again.spz"
    content = SplatFile(trained_splats(50, degree, seed), antialiased=antialiased)
    again = read(write(path, content, version, sh_bits))
    check_within_quantisation(content.splats, again.splats, version, sh_bits=sh_bits)
    assert again.antialiased is antialiased
    assert again.properties == {"version": str(version), "fractional bits": "12"}
    # Equal input gives equal bytes, and what has been rounded once stays.
    first = path.read_bytes()
    assert write(path, content, version, sh_bits).read_bytes() == first
    twice = read(write(path, again, version, sh_bits)).splats
    for name in ("means", "opacities", "colors", "scales"):
        assert largest(twice.tensors()[name], again.splats.tensors()[name]) <= 1e-6, name


def test_the_layout_is_that_of_the_official_encoder(tmp_path):
    one = replace(
        random_splats(1, 1, dtype=torch.float64),
        means=torch.tensor([[1.0, -2.0, 0.5]]).double(),
        opacities=torch.tensor([0.8]).double(),
        scales=torch.tensor([[1.0, math.exp(-2), math.exp(1)]]).double(),
        quats=torch.tensor([[0.5, 0.5, 0.5, -0.5]]).double(),
        colors=Sh(torch.tensor([[[0.0, 1.0, -1.0], [0.5] * 3, [-0.5] * 3, [0.25] * 3]]), 1),
    )
    raw = gzip.decompress(write(tmp_path / "a.spz", SplatFile(one, antialiased=True)).read_bytes())
    assert raw[:16] == struct.pack("<4sIIBBBB", b"NGSP", 3, 1, 1, 12, 1, 0)
    # The frame of the file is x right, y up, z back: y and z change their signs.
    positions = b"".join((value & 0xFFFFFF).to_bytes(3, "little") for value in (4096, 8192, -2048))
    assert raw[16:25] == positions
    assert raw[25:29] == bytes([204, 128, 166, 89])
    assert raw[29:32] == bytes([160, 128, 176])
    # Rotated by the flips, xyzw is (.5, -.5, .5, .5); the largest is the first, x: then y, z, w.
    half = round(511 * 0.5 / math.sqrt(0.5))
    packed = (0 << 30) | ((512 | half) << 20) | (half << 10) | half
    assert raw[32:36] == packed.to_bytes(4, "little")
    # Band 1 is (-y, z, -x): two signs change. Steps of 1/128, in buckets of 8.
    assert raw[36:] == bytes([64] * 3 + [192] * 3 + [160] * 3)


def test_a_file_is_the_scene_turned_by_half_a_turn_about_x(tmp_path):
    given = trained_splats(40, 3)
    turn = Similarity(rotation=torch.diag(torch.tensor([1.0, -1.0, -1.0]).double()))
    turned = transform_splats(given, turn)
    path = write(tmp_path / "a.spz", given)
    raw = gzip.decompress(path.read_bytes())
    positions = [int.from_bytes(raw[16 + 3 * i : 19 + 3 * i], "little") for i in range(120)]
    signed = torch.tensor([value - (value >> 23 << 24) for value in positions]).view(-1, 3)
    assert largest(signed / 4096, turned.means) <= 0.5 / 4096 + 1e-9
    assert read(path).up == ""


@pytest.mark.parametrize(("name", "version"), [("raw", 2), ("v2", 2), ("v3", 3), ("v4", 4)])
def test_files_of_another_encoder_are_read(shared_data, name, version):
    path = shared_data / "splats" / "fixtures" / f"minimal-{name}.spz"
    assert SpzImporter.recognises(path)
    content = read(path)
    assert len(content.splats) == 4
    assert content.properties["version"] == str(version)
    corners = sorted((abs(x), abs(y), abs(z)) for x, y, z in content.splats.means.tolist())
    assert corners == [(0, 0, 0), (0, 0, 1), (1, 0, 0), (1, 0, 1)]
    assert torch.allclose(content.splats.opacities, torch.tensor(0.902).double(), atol=1e-3)
    assert torch.allclose(content.splats.scales, torch.tensor(0.099).double(), atol=1e-3)
    identity = torch.tensor([[1.0, 0, 0, 0]]).expand(4, 4)
    assert alignment(content.splats.quats, identity) > 0.9999


def test_positions_of_version_1_are_halves(tmp_path):
    header = struct.pack("<4sIIBBBB", b"NGSP", 1, 2, 0, 12, 0, 0)
    positions = struct.pack("<6e", 1, 2, 3, -0.5, 0.25, 1000)
    rest = bytes([128] * 2 + [128] * 6 + [160] * 6 + [128, 128, 128] * 2)
    (tmp_path / "a.spz").write_bytes(gzip.compress(header + positions + rest))
    means = read(tmp_path / "a.spz").splats.means
    assert means.tolist() == [[1, -2, -3], [-0.5, -0.25, -1000]]


@pytest.mark.parametrize("version", [2, 3, 4])
def test_the_axes_of_ply_are_written_on_demand_and_stated(tmp_path, version):
    """SuperSplat and splat-transform take all SPZ for such files since May 2026."""
    given, path = trained_splats(60, 2), tmp_path / "a.spz"
    SpzExporter(version=version, axes="rdf").write(path, SplatFile(given))
    check_within_quantisation(given, read(path).splats, version)
    header, streams, signs = read_streams(path)
    assert (signs, header.is_extended) == ((1.0, 1.0, 1.0), True)
    stored = unpacked(streams, header).means
    assert largest(torch.from_numpy(stored), given.means) <= 0.5**header.bits


def test_a_frame_that_an_extension_states_is_respected(tmp_path):
    # Adobe's record, kind 0xADBE0003, says RDF (6): nothing has to be turned. LUF is 7.
    given = trained_splats(5, 1)
    rub = read(write(tmp_path / "a.spz", given)).splats
    raw = bytearray(gzip.decompress((tmp_path / "a.spz").read_bytes()))
    raw[14] |= 2
    other = struct.pack("<II3s", 0xADBE0002, 3, b"abc")
    for frame, signs in ((0, (1, 1, 1)), (4, (1, 1, 1)), (6, (1, -1, -1)), (7, (-1, 1, -1))):
        record = other + struct.pack("<III", 0xADBE0003, 4, frame)
        (tmp_path / "b.spz").write_bytes(gzip.compress(bytes(raw) + record))
        assert largest(read(tmp_path / "b.spz").splats.means, rub.means * torch.tensor(signs)) == 0
    record = struct.pack("<III", 0xADBE0003, 4, 12)
    (tmp_path / "b.spz").write_bytes(gzip.compress(bytes(raw) + record))
    assert refusal(tmp_path / "b.spz").startswith("FILE: its stored frame (Adobe's record) has")
    (tmp_path / "b.spz").write_bytes(gzip.compress(bytes(raw) + b"\xff" * 9))
    assert len(read(tmp_path / "b.spz").splats) == 5


@pytest.mark.parametrize("version", VERSIONS)
def test_large_files_are_recognised(tmp_path, version):
    # The tables of codes of a large gzip block are longer than the header of the file.
    assert SpzImporter.recognises(write(tmp_path / "a.spz", trained_splats(3000, 3), version))


def test_bits_of_positions_follow_the_extent_and_the_size_of_the_splats(tmp_path):
    given = trained_splats(200, 0)
    given.means[0, 0] = 10

    def bits(factor):
        scaled = replace(given, means=given.means * factor, scales=given.scales * factor)
        again = read(write(tmp_path / "a.spz", scaled))
        number = int(again.properties["fractional bits"])
        assert largest(again.splats.means, scaled.means) <= 0.5 / 2**number + 1e-9
        return number

    assert bits(1.0) == 12
    assert bits(0.01) == 16  # An object of 10 cm: 12 bits would be coarser than its splats.
    assert bits(1000) == 9
    assert bits(800_000) == 0
    # 24 bits reach as far, but the splats would be moved by more than their size.
    for factor in (1e7, 1e5):
        with pytest.raises(ValueError, match=r"^means: row 0 is .* apart, and the median splat is"):
            write(tmp_path / "b.spz", replace(given, means=given.means * factor))
    with pytest.raises(ValueError, match=r"^means: row 0 is 1e\+08 from the origin, where 24-bit"):
        write(
            tmp_path / "b.spz",
            replace(given, means=given.means * 1e7, scales=given.scales * 1e7),
        )
    assert not (tmp_path / "b.spz").exists()


def test_values_outside_of_the_range_of_the_format_are_its_ends(tmp_path):
    given = trained_splats(2, 1)
    given = replace(
        given,
        opacities=torch.tensor([0.0, 1.0]).double(),
        scales=torch.tensor([[0.0, 1.0, 1e9]] * 2).double(),
        colors=Sh(torch.tensor([9.0, -9.0])[:, None, None].expand(2, 4, 3).clone(), 1),
    )
    again = read(write(tmp_path / "a.spz", given)).splats
    assert again.opacities.tolist() == pytest.approx([0, 1], abs=1e-8)
    assert again.scales.log()[0].tolist() == pytest.approx([-10, 0, 255 / 16 - 10])
    assert again.colors.coefficients[:, 0, 0].tolist() == pytest.approx([10 / 3, -10 / 3])
    # Band 1 is y, z, x; the first two have the other sign in the file: its range is -1 to 127/128.
    assert again.colors.coefficients[0, 1:, 0].tolist() == pytest.approx([1, 1, 127 / 128])


def test_bands_that_a_version_does_not_hold_are_left_out(tmp_path):
    given = trained_splats(10, 4)
    assert read(write(tmp_path / "a.spz", given, 3)).splats.colors.degree == 3
    assert read(write(tmp_path / "a.spz", given, 4)).splats.colors.degree == 4


@pytest.mark.unchecked
def test_other_versions_are_not_written():
    with pytest.raises(ConfigError) as caught:
        SpzExporter(version=1)
    assert str(caught.value) == (
        "format.version=1: SPZ is written in version 2, 3 or 4.\n"
        "Leave it out for 3, which most viewers read."
    )
    with pytest.raises(ConfigError) as caught:
        SpzExporter(sh_bits=9)
    assert str(caught.value) == "format.sh_bits=9: expected 4 to 8."
    with pytest.raises(ConfigError) as caught:
        SpzExporter(axes="xyz")
    assert str(caught.value) == "format.axes=xyz: expected rub or rdf."


def test_a_missing_zstandard_is_one_sentence(tmp_path, monkeypatch):
    path = write(tmp_path / "a.spz", trained_splats(3, 0), 4)
    monkeypatch.setitem(__import__("sys").modules, "backports.zstd", None)
    advice = (
        "\nInstall it with: pip install 'gsfw[spz]' (or: pip install backports.zstd). "
        "Versions 2 and 3 need nothing more."
    )
    missing = " needs Zstandard, and the package backports.zstd is not installed."
    with pytest.raises(UnavailableError) as caught:
        read(path)
    assert str(caught.value) == f"{path}: SPZ of version 4{missing}{advice}"
    with pytest.raises(UnavailableError) as caught:
        write(tmp_path / "b.spz", trained_splats(3, 0), 4)
    assert str(caught.value) == f"format.version=4{missing}{advice}"
    assert len(read(write(tmp_path / "b.spz", trained_splats(3, 0), 3)).splats) == 3


def test_files_that_are_no_spz_are_refused(tmp_path):
    path = tmp_path / "a.spz"
    assert refusal(path) == "FILE cannot be read: No such file or directory."
    assert not SpzImporter.recognises(path)
    for content in (b"", b"hello", b"NGS", gzip.compress(b"hello, world")):
        path.write_bytes(content)
        assert refusal(path) == "FILE is not an SPZ file: it does not begin with 'NGSP'."
        assert not SpzImporter.recognises(path)
    path.write_bytes(b"\x1f\x8b not gzip")
    assert refusal(path).startswith("FILE is a damaged SPZ file: Error -3 while decompressing")
    assert not SpzImporter.recognises(path)


@pytest.mark.parametrize(
    ("version", "count", "degree", "bits", "message"),
    [
        (5, 1, 0, 12, "FILE is SPZ of version 5; versions 1 to 4 are read.\nConvert it to version"),
        (3, 0, 0, 12, "FILE contains no splats: its header announces 0."),
        (3, 1, 5, 12, f"FILE is a damaged SPZ file: its header states SH degree 5.\n{COPY}"),
        (3, 1, 0, 99, f"FILE is a damaged SPZ file: its header states 99 fractional bits.\n{COPY}"),
        (4, 1, 0, 12, f"FILE is a damaged SPZ file: version 4 in gzip.\n{COPY}"),
    ],
)
def test_headers_that_no_encoder_writes_are_refused(
    tmp_path, version, count, degree, bits, message
):
    header = struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, bits, 0, 5)
    if version == 4:
        header += struct.pack("<I12x", 32)
    (tmp_path / "a.spz").write_bytes(gzip.compress(header + bytes(64)))
    assert refusal(tmp_path / "a.spz").startswith(message)


@pytest.mark.parametrize("version", VERSIONS)
def test_a_file_that_is_cut_short_is_refused(tmp_path, version):
    raw = write(tmp_path / "a.spz", trained_splats(20, 1), version).read_bytes()
    for end in (4, 12, 20, 60, len(raw) // 2, len(raw) - 1):
        (tmp_path / "a.spz").write_bytes(raw[:end])
        assert "FILE is " in refusal(tmp_path / "a.spz")
    header = struct.pack("<4sIIBBBB", b"NGSP", 3, 5, 0, 12, 0, 0)
    for form in (bytes, gzip.compress):
        (tmp_path / "a.spz").write_bytes(form(header + bytes(99)))
        said = refusal(tmp_path / "a.spz")
        assert "is cut short" in said
        assert "its header announces 5 splats, 100 bytes" in said


def bomb(size, count):
    """A gzip of few bytes that grows to many, and announces so many splats."""
    encoder = zlib.compressobj(wbits=31)
    header = struct.pack("<4sIIBBBB", b"NGSP", 3, count, 0, 12, 0, 0)
    parts = [encoder.compress(header)]
    parts += [encoder.compress(bytes(1 << 20)) for _ in range(size >> 20)]
    return b"".join(parts) + encoder.flush()


def test_bombs_are_refused_at_the_size_that_the_header_justifies(tmp_path):
    path = tmp_path / "a.spz"
    tracemalloc.start()
    path.write_bytes(bomb(32 << 20, 5))
    assert refusal(path) == (
        "FILE is damaged: its header announces 5 splats, 100 bytes, and more follow.\n" + COPY
    )
    path.write_bytes(bomb(1 << 20, 2**32 - 1))
    said = refusal(path)
    assert "its header announces 4294967295 splats, 85899345900 bytes, which a file of" in said
    whole = write(tmp_path / "b.spz", trained_splats(9, 0), 4).read_bytes()
    for place, value in ((8, 2**31), (40, 2**40), (56, 2**62), (32, 2**60), (16, 2**31)):
        form = "<Q" if place >= 32 else "<I"
        changed = bytearray(whole)
        changed[place : place + struct.calcsize(form)] = struct.pack(form, value)
        path.write_bytes(changed)
        assert "FILE is " in refusal(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4_000_000


def test_a_zstandard_bomb_is_refused(tmp_path):
    from backports.zstd import compress

    raw = bytearray(write(tmp_path / "a.spz", trained_splats(9, 0), 4).read_bytes())
    sizes = [struct.unpack_from("<Q", raw, 32 + 16 * index)[0] for index in range(5)]
    grown = compress(bytes(1 << 24))
    raw[112 + sum(sizes[:4]) :] = grown
    raw[32 + 64 : 32 + 72] = struct.pack("<Q", len(grown))
    (tmp_path / "a.spz").write_bytes(raw)
    tracemalloc.start()
    assert refusal(tmp_path / "a.spz") == (
        f"FILE is a damaged SPZ file: its stream 5: it does not hold 36 bytes.\n{COPY}"
    )
    assert tracemalloc.get_traced_memory()[1] < 1_000_000
    tracemalloc.stop()


def test_a_place_that_cannot_be_written_to_is_refused(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot be written"):
        write(tmp_path / "file" / "a.spz", trained_splats(5, 1))


@pytest.mark.parametrize("size", [1.0, 2e7, 3e38])
def test_sh_of_any_size_is_stored_as_the_nearest_end(size):
    rest = np.array([[[size, -size, size]]], dtype=np.float32)
    assert list(packed_bands(rest, bits=8)) == [255, 0, 255]
