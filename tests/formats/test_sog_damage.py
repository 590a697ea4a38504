"""Damaged and hostile SOG: one clear error each, and no memory that the file does not justify."""

import io
import json
import random
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
import torch
from PIL import Image
from support.damage import damaged
from support.refusals import refusal_of
from support.scenes import random_splats

from gsfw.core.errors import DataError
from gsfw.core.exchange import SplatFile
from gsfw.core.splats import Splats
from gsfw.formats.sog.exporter import SogExporter
from gsfw.formats.sog.importer import SogImporter

COPY = "It may have been cut short or changed in copying; get it again."


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Description and images of a sound file."""
    path = tmp_path_factory.mktemp("sog") / "a.sog"
    SogExporter().write(path, SplatFile(random_splats(80, 1, dtype=torch.float64)))
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    return json.loads(files.pop("meta.json")), files


def packed(path, meta, files, method=zipfile.ZIP_STORED):
    """An archive of these."""
    content = meta if isinstance(meta, bytes) else json.dumps(meta).encode()
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in {"meta.json": content, **files}.items():
            archive.writestr(name, data)
    return path


refusal = refusal_of(SogImporter().read)


def image(width, height, values=0, **options):
    buffer = io.BytesIO()
    pixels = np.full((height, width, 4), values, dtype=np.uint8)
    Image.fromarray(pixels).save(buffer, "WEBP", lossless=True, exact=True, **options)
    return buffer.getvalue()


def set_in(meta, place, value):
    """A copy of a description with one value changed, or left out."""
    copy = json.loads(json.dumps(meta))
    *outer, last = place.split(".")
    inner = copy
    for name in outer:
        inner = inner[name]
    if value is None:
        del inner[last]
    else:
        inner[last] = value
    return copy


WRONG = [
    ("count", None, "FILE: count of its header is missing; expected a whole number"),
    ("count", "many", "FILE: count of its header: expected a whole number of at least 1, found"),
    ("count", 0, "FILE: count of its header: expected a whole number of at least 1, found 0."),
    ("count", 321, "FILE: its image means_l.webp is 12 x 8; 321 texels are described."),
    (
        "count",
        10**12,
        "FILE is cut short: it describes 1000000000000 splats, and",
    ),
    ("version", 3, "FILE is a SOG of version 3; gsfw reads 1 and 2."),
    ("version", True, "FILE: version of its header: expected a whole number of at least 0, found"),
    ("model", "2dgs", "FILE holds flat splats (2DGS), not 3D Gaussians."),
    ("means.mins", [0, 0], "FILE: means.mins of its header: expected 3 finite numbers, found"),
    ("means.mins", [0, 0, 1e999], "FILE: means.mins[2] of its header: expected one finite"),
    ("means.maxs", [0, 0, 700], "FILE: means.maxs: expected logarithms up to 80."),
    ("means.files", ["means_l.webp"], "FILE: means.files: expected 2 plain names of images beside"),
    ("means.files", [1, 2], "FILE: means.files of its header: expected a list of texts, found"),
    ("quats.files", ["../quats.webp"], "FILE: quats.files: expected 1 plain names of images"),
    ("quats.files", ["/etc/passwd"], "FILE: quats.files: expected 1 plain names of images beside"),
    ("quats.files", ["C:quats.webp"], "FILE: quats.files: expected 1 plain names of images beside"),
    ("quats.files", ["other.webp"], "FILE: there is no other.webp, which belongs to it."),
    ("scales.codebook", [1.0], "FILE: scales.codebook of its header: expected 256 finite numbers"),
    ("scales.codebook", [[0.0]] * 256, "FILE: scales.codebook[0] of its header: expected one f"),
    ("scales.codebook", None, "FILE: scales.codebook of its header is missing; expected 256 "),
    ("sh0", None, "FILE is no SOG: its meta.json has no means, scales, quats, sh0 with files."),
    ("shN.bands", 4, "FILE: expected SH of degree 0 to 3 and up to 65536 vectors of"),
    ("shN.bands", 2, "FILE: its image shN_centroids.webp is 192 texels wide, which belongs to no"),
    (
        "shN.count",
        65537,
        "FILE: expected SH of degree 0 to 3 and up to 65536 vectors of",
    ),
    ("shN.count", 65, "FILE: 65 SH vectors are described, and shN_centroids.webp has 64."),
    ("shN.count", 3, "labels in shN_labels.webp are beyond the 3 SH vectors."),
    ("shN", [1], "FILE: shN of its header: expected an object, found [1]."),
]


@pytest.mark.parametrize(("place", "value", "message"), WRONG, ids=str)
def test_wrong_descriptions_are_refused_by_name(tmp_path, parts, place, value, message):
    meta, files = parts
    assert message in refusal(packed(tmp_path / "a.sog", set_in(meta, place, value), files))


def test_legacy_descriptions_are_checked_too(tmp_path, parts):
    meta, files = parts
    legacy = set_in(meta, "version", None)
    for key, sides in (("scales", 3), ("sh0", 4), ("shN", 3)):
        legacy[key] |= {"mins": [0.0] * sides, "maxs": [1.0] * sides}
    path = tmp_path / "a.sog"
    assert "means.shape of its header is missing" in refusal(packed(path, legacy, files))
    for shape in ([], [0, 3], [2.5, 3]):
        said = refusal(packed(path, set_in(legacy, "means.shape", shape), files))
        assert "means.shape: expected the number of splats" in said


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[" * 100_000, b"{}", b"[1]", b"\xff\xfe", b'{"means": 1e9999}']
)
def test_descriptions_that_are_none_are_refused(tmp_path, parts, content):
    path = packed(tmp_path / "a.sog", content, parts[1])
    assert refusal(path).startswith(("FILE: its meta.json is damaged JSON", "FILE is no SOG"))
    assert not SogImporter.recognises(path)


def test_a_description_that_is_too_long_is_not_read(tmp_path, parts):
    path = packed(tmp_path / "a.sog", b" " * (1 << 21), parts[1])
    assert refusal(path) == f"FILE: its meta.json is longer than 1048576 bytes.\n{COPY}"


def test_other_files_are_refused_and_not_recognised(tmp_path, parts):
    path = tmp_path / "a.sog"
    assert refusal(path) == "FILE cannot be read: No such file or directory."
    for content in (b"", b"hello", b"ply\n", bytes(100)):
        path.write_bytes(content)
        assert refusal(path).startswith("FILE is no SOG: neither a ZIP archive nor a JSON.")
        assert not SogImporter.recognises(path)
    path.write_bytes(b"PK\x03\x04 and no more")
    assert refusal(path) == f"FILE is a damaged ZIP archive.\n{COPY}"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("other.txt", "no description")
    assert refusal(path) == f"FILE: there is no meta.json, which belongs to it.\n{COPY}"
    assert not SogImporter.recognises(path)
    assert not SogImporter.recognises(tmp_path)


def test_a_ply_beside_a_description_is_not_taken_for_it(tmp_path, parts):
    (tmp_path / "meta.json").write_text(json.dumps(parts[0]))
    (tmp_path / "a.ply").write_bytes(b"ply\n")
    assert not SogImporter.recognises(tmp_path / "a.ply")


@pytest.mark.parametrize("name", ["means_u.webp", "shN_centroids.webp"])
def test_images_that_are_none_are_refused(tmp_path, parts, name):
    meta, files = parts
    path = tmp_path / "a.sog"
    sound = files[name]
    for content in (b"", b"RIFF", sound[:40], b"GIF89a" + bytes(40), sound[:12] + b"VP8Q" * 9):
        said = refusal(packed(path, meta, {**files, name: content}))
        assert said == f"FILE: its image {name} is damaged.\n{COPY}"


def test_untold_components_of_rotations_are_refused(tmp_path, parts):
    meta, files = parts
    path = packed(tmp_path / "a.sog", meta, {**files, "quats.webp": image(12, 8, 251)})
    assert "80 of 80 rotations in quats.webp do not tell their largest component" in refusal(path)


def test_infinite_values_are_dropped_and_counted(tmp_path, parts):
    meta, files = parts
    levels = [*meta["scales"]["codebook"][:200], *[1e300] * 56]
    used = np.asarray(Image.open(io.BytesIO(files["scales.webp"])))[..., :3].reshape(-1, 3)[:80]
    path = packed(tmp_path / "a.sog", set_in(meta, "scales.codebook", levels), files)
    content = SogImporter().read(path)
    assert content.num_dropped == (used >= 200).any(axis=1).sum() > 0


def lying(width, height):
    """Images of a few bytes that announce a size."""
    bits = (width - 1) | (height - 1) << 14
    plain = image(4, 4)
    short = plain[:21] + struct.pack("<I", bits) + plain[25:]
    frame = b"VP8X" + struct.pack("<IB3x", 10, 0)
    frame += (width - 1).to_bytes(3, "little") + (height - 1).to_bytes(3, "little")
    body = b"WEBP" + frame + plain[12:]
    png = io.BytesIO()
    Image.new("RGBA", (4, 4)).save(png, "PNG")
    chunk = bytearray(png.getvalue())
    chunk[16:24] = struct.pack(">II", width, height)
    return [short, b"RIFF" + struct.pack("<I", len(body)) + body, bytes(chunk)]


def test_sizes_that_nothing_justifies_are_refused_before_they_are_reserved(tmp_path, parts):
    meta, files = parts
    path = tmp_path / "a.sog"
    tracemalloc.start()
    for content in lying(16000, 16000):
        for name in ("means_l.webp", "shN_labels.webp", "shN_centroids.webp"):
            said = refusal(packed(path, meta, {**files, name: content}))
            assert said.startswith(f"FILE: its image {name} is "), said
    # A true image of four million equal texels, which takes few bytes.
    whole = image(2000, 2000, method=0)
    said = refusal(packed(path, set_in(meta, "count", 4_000_000), {**files, "means_l.webp": whole}))
    assert said.startswith("FILE is cut short: it describes 4000000 splats, and their images have")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 40_000_000  # The image that the test itself makes.


def test_entries_that_unpack_to_more_than_an_image_takes_are_not_unpacked(tmp_path, parts):
    meta, files = parts
    path = tmp_path / "a.sog"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("meta.json", json.dumps(meta))
        for name, data in files.items():
            archive.writestr(name, data if name != "sh0.webp" else bytes(20_000_000))
    assert "its sh0.webp is longer than" in refusal(path)


@pytest.mark.parametrize("method", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_entries_of_other_compressions_are_refused_and_not_unpacked(tmp_path, parts, method):
    path = packed(tmp_path / "a.sog", *parts, method)
    raw = bytearray(path.read_bytes())
    start = raw.index(b"meta.json") + len(b"meta.json")
    raw[start + 4 : start + 9] = b"\xff" * 5  # Settings of LZMA: none that there are, and 4 GB.
    for content in (path.read_bytes(), raw):
        path.write_bytes(content)
        assert refusal(path) == (
            "FILE: its meta.json is neither stored nor deflated, but compressed by method "
            f"{method} of ZIP.\nUnpack it, and choose the meta.json beside its images."
        )
        assert not SogImporter.recognises(path)


def test_deflated_entries_are_read(tmp_path, parts):
    path = packed(tmp_path / "a.sog", *parts, zipfile.ZIP_DEFLATED)
    assert len(SogImporter().read(path).splats) == 80


def test_an_encrypted_or_damaged_entry_is_refused(tmp_path, parts):
    meta, files = parts
    path = packed(tmp_path / "a.sog", meta, files)
    raw = bytearray(path.read_bytes())
    place = raw.index(files["quats.webp"][20:60])
    raw[place] ^= 255
    path.write_bytes(raw)
    assert refusal(path) == f"FILE: its quats.webp is damaged.\n{COPY}"


def test_damage_of_files_in_a_folder_is_one_clear_error_or_none(tmp_path, parts):
    meta, files = parts
    every = {"meta.json": json.dumps(meta).encode(), **files}
    for name, content in every.items():
        (tmp_path / name).write_bytes(content)
    refused = 0
    for seed in range(100):
        name = random.Random(-seed).choice([*every])
        (tmp_path / name).write_bytes(damaged(every[name], [], seed))
        SogImporter.recognises(tmp_path / "meta.json")
        try:
            assert isinstance(SogImporter().read(tmp_path / "meta.json").splats, Splats), seed
        except DataError:
            refused += 1
        (tmp_path / name).write_bytes(every[name])
    assert refused > 40
