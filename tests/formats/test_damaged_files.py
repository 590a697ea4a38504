"""Damaged files of every format end in splats or in words: never another error, a hang, or memory.

Every registered importer is tested with every file that an exporter writes for it, so that a new
format needs no line here, and with files as other tools write them (support/foreign_files.py); the
reader of model files is tested as importers are.
"""

import struct
import zlib
from dataclasses import replace

import numpy as np
import pytest
import torch
from support.bombs import bombs
from support.damage import damaged
from support.reader_faults import CAN_STOP, complaint, complaints, little_memory, traced
from support.readers_under_test import MODELS, Reader, Sound, readers
from support.sampling import sampled
from support.small_scene import SHARED_DATA

from gsfw.core.errors import DataError
from gsfw.core.exchange import Holds, Importer
from gsfw.formats.ply import PlyImporter
from gsfw.plugins.exporters import make_exporter
from gsfw.plugins.initial_splats import find_importer
from gsfw.plugins.loading import load_all
from gsfw.plugins.registry import installed
from gsfw.testing.sources import splat_file

pytestmark = pytest.mark.unchecked

FORMATS = sorted([*installed().slot("importer"), MODELS])
DAILY = sampled([(name,) for name in FORMATS], [FORMATS.index(name) for name in ("ply", "spz")])
"""All, of which plain ``pytest`` takes one with a header in words and one that is compressed."""
COMPRESSED = {"sog", "spz", "usd", MODELS}
"""Formats with parts that are unpacked."""
WRITTEN = sorted(
    name
    for name, kind in load_all("exporter", installed()).items()
    if kind.holds is Holds.SPLATS and kind.is_readable and not kind.is_folder
)
FEWER = {"usd": 100}
"""Divisor of the damaged files of formats that a process of its own reads: each takes a second."""
REAL = SHARED_DATA / "splats"
"""Files of other tools."""


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    return readers(tmp_path_factory.mktemp("sound"))


every_format = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in FEWER)) for name in FORMATS]
)


@every_format
def test_every_importer_reads_the_files_that_are_written_for_it(known, tmp_path, name):
    assert known[name].sound, "no exporter writes such files"
    for sound in known[name].sound:
        path = sound.write(tmp_path, f"sound-{sound.label}")
        assert complaint(known[name].kind, path) == "", sound.label
        found = known[name].kind().read(path)
        assert (found.rows if name == MODELS else len(found.splats)) == sound.count
        others = [kind for kind in known.values() if kind.name != name]
        assert not [other.name for other in others if other.kind.recognises(path)]


@pytest.mark.parametrize("form", WRITTEN)
def test_a_file_of_many_splats_is_recognised_too(tmp_path, form):
    exporter = make_exporter(form, installed())
    path = tmp_path / f"many{exporter.suffix}"
    exporter.write(path, splat_file(700, 3))
    assert len(find_importer(path, installed()).read(path).splats) == 700


@pytest.mark.parametrize("name", DAILY)
def test_damaged_files_end_in_splats_or_in_words(known, tmp_path, name):
    assert complaints(known[name], tmp_path, 300 // FEWER.get(name, 1)) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_many_damaged_files_end_in_splats_or_in_words(known, tmp_path, name):
    count = 3_700 // FEWER.get(name, 1)
    assert complaints(known[name], tmp_path, count, first=300) == []


@pytest.mark.parametrize("name", DAILY)
def test_a_small_file_does_not_unpack_to_a_large_one(known, tmp_path, name):
    # One bomb of each kind.
    made = {kind: make for sound in known[name].sound for kind, make in bombs(sound.content)}
    assert bool(made) == (name in COMPRESSED)
    if not made:
        pytest.skip(f"nothing in a {name} file is compressed")
    path = tmp_path / f"bomb{known[name].sound[0].suffix}"
    for kind, make in made.items():
        path.write_bytes(make())
        with little_memory(), traced():
            assert complaint(known[name].kind, path) == "", kind
        with pytest.raises(DataError):
            known[name].kind().read(path)


@every_format
def test_a_file_of_any_other_format_is_refused_in_words(known, tmp_path, name):
    for other in known.values():
        for sound in other.sound:
            path = tmp_path / f"other{known[name].sound[0].suffix}"
            path.write_bytes(sound.content)
            assert complaint(known[name].kind, path) == ""


def test_signalling_nans_in_the_bounds_of_a_compressed_ply_are_no_warning(known, tmp_path):
    reader = known["compressed-ply"]
    start, end, rows = reader.sound[0].content.partition(b"end_header\n")
    path = tmp_path / "a.compressed.ply"
    path.write_bytes(start + end + struct.pack("<I", 0x7FA00000) + rows[4:])
    assert complaint(reader.kind, path) == ""


def real_files():
    return sorted(path for path in REAL.rglob("*") if path.is_file()) if REAL.is_dir() else []


@pytest.mark.slow
@pytest.mark.skipif(not real_files(), reason=f"no files of other tools below {REAL}")
@pytest.mark.parametrize("path", real_files(), ids=lambda path: path.name)
def test_files_of_other_tools_are_read_and_refused_when_they_are_damaged(known, tmp_path, path):
    kinds = [reader for reader in known.values() if reader.kind.recognises(path)]
    if not kinds:
        pytest.skip(f"no importer reads {path.name}")
    (reader,) = kinds
    assert complaint(reader.kind, path) == ""
    whole = path.read_bytes()
    sound = Sound(path.name, path.name[path.name.index(".") :], whole)
    count = 100 if len(whole) < 10_000 else 2
    assert complaints(replace(reader, sound=(sound,)), tmp_path, count) == []


class _Own(Importer):
    """A reader with a fault."""

    @classmethod
    def recognises(cls, path):
        return True


class _Raises(_Own):
    def read(self, path):
        struct.unpack("<500I", path.read_bytes()[:2000])
        return PlyImporter().read(path)


class _Hangs(_Own):
    def read(self, path):
        while path.stat().st_size < 1000:
            pass
        return PlyImporter().read(path)


class _Trusts(_Own):
    def read(self, path):
        count = zlib.crc32(path.read_bytes()) % 1_000_000_000
        np.empty(count, np.uint8)
        raise DataError(f"{path} is damaged.")


class _TrustsUnseen(_Own):
    """Memory of PyTorch, which tracemalloc does not see."""

    def read(self, path):
        torch.empty(1_000_000_000)
        raise DataError(f"{path} is damaged.")


class _Warns(_Own):
    def read(self, path):
        np.float32(1e38) * np.float32(1e38)
        return PlyImporter().read(path)


class _Trustful(_Own):
    def read(self, path):
        content = PlyImporter().read(path)
        content.splats.opacities[0] = np.nan
        return content


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        (_Raises, "error: unpack requires a buffer of 2000 bytes"),
        (_Trusts, "it allocated "),
        (_TrustsUnseen, "RuntimeError: "),
        (_Warns, "RuntimeWarning: overflow encountered"),
        (_Trustful, "it returned values that are not finite, or out of range"),
    ],
)
def test_a_fault_of_a_reader_is_found(known, tmp_path, kind, words):
    files = tuple(sound for sound in known["ply"].sound)
    found = complaints(Reader("own", kind, files), tmp_path, 60)
    assert any(words in line for line in found)
    assert all(line.startswith("own: ") for line in found)


@pytest.mark.skipif(not CAN_STOP, reason="the system has no alarm that stops a reader")
def test_a_reader_that_hangs_is_stopped(tmp_path):
    (tmp_path / "a").write_bytes(b"few bytes")
    assert complaint(_Hangs, tmp_path / "a", seconds=0.05) == "it goes on for more than 0.05 s"


def test_the_same_seed_makes_the_same_file():
    sound = Sound("x", ".x", bytes(range(200)))
    files = [damaged(sound.content, [], seed) for seed in range(100)]
    assert files == [damaged(sound.content, [], seed) for seed in range(100)]
    assert len(set(files)) > 90
