"""An archive of arrays reads back bit by bit, and bad ones are refused before memory is taken."""

import errno
import io
import json
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
from support.refusals import refusal_of

from gsfw.core.errors import DataError, OutputError
from gsfw.formats.array_archive import DTYPES, ArrayArchive, read_archive, write_archive


def some_arrays():
    generator = np.random.default_rng(0)
    arrays = {
        f"state/{index}.values": (100 * generator.random((3, 2))).astype(dtype)
        for index, dtype in enumerate(DTYPES)
    }
    return {**arrays, "scalar": np.float32(0.5)[()] * np.ones((), "<f4"), "none": np.zeros((0, 8))}


def written(path, arrays=None, header=None):
    archive = ArrayArchive({"version": 1} if header is None else header, arrays or some_arrays())
    write_archive(path, archive)
    return path


def archive_of(path, entries, compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as file:
        for name, content in entries:
            file.writestr(name, content)
    return path


def npy(shape, dtype="<f4", body=b"", order=False, version=(1, 0)):
    text = repr({"descr": dtype, "fortran_order": order, "shape": shape})
    text = f"{text[:-1]}, }}\n"
    head = b"\x93NUMPY" + bytes(version) + struct.pack("<H", len(text)) + text.encode()
    return head + body


refusal = refusal_of(read_archive)


def test_arrays_of_every_type_and_the_header_read_back_bit_by_bit(tmp_path):
    header = {"version": 1, "text": "Gänge", "nested": [{"a": None}]}
    read = read_archive(written(tmp_path / "a.gsfw", header=header))
    assert read.header == header
    for name, array in some_arrays().items():
        assert read.arrays[name].dtype == array.dtype
        assert read.arrays[name].shape == array.shape
        assert read.arrays[name].tobytes() == array.tobytes()


def test_numpy_alone_reads_it(tmp_path):
    with np.load(written(tmp_path / "a.gsfw")) as archive:
        assert json.loads(archive["header.json"]) == {"version": 1}
        assert np.array_equal(archive["state/1.values"], some_arrays()["state/1.values"])


def test_the_same_content_makes_the_same_bytes(tmp_path):
    first, second = (written(tmp_path / name).read_bytes() for name in ("a", "b"))
    assert first == second


def test_the_header_is_read_without_the_arrays(tmp_path):
    path = written(tmp_path / "a.gsfw")
    assert read_archive(path, header_only=True) == ArrayArchive({"version": 1}, {})


@pytest.mark.parametrize(
    ("name", "array", "problem"),
    [
        ("objects", np.array([{}]), "objects is of type object"),
        ("words", np.array(["a"]), "words is of type <U1"),
        ("../up", np.zeros(1), "'../up' cannot be the name of an array"),
        ("/root", np.zeros(1), "'/root' cannot be the name of an array"),
    ],
)
def test_what_has_no_place_in_it_is_not_written(tmp_path, name, array, problem):
    with pytest.raises(ValueError, match=problem):
        written(tmp_path / "a", {name: array})
    assert list(tmp_path.iterdir()) == []


def test_writing_holds_no_second_copy_of_the_arrays(tmp_path):
    arrays = {name: np.zeros(24 << 20, "|u1") for name in ("a", "b", "c")}
    tracemalloc.start()
    written(tmp_path / "large", arrays)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 40 << 20
    assert read_archive(tmp_path / "large").arrays["c"].shape == (24 << 20,)


def test_a_write_that_fails_in_an_array_keeps_the_old_file(tmp_path, monkeypatch):
    before = written(tmp_path / "a").read_bytes()

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(OutputError, match="the disk is full"):
        written(tmp_path / "a")
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [before]


def test_a_file_that_is_cut_short_anywhere_is_refused(tmp_path):
    whole = written(tmp_path / "a").read_bytes()
    for length in range(0, len(whole), 293):
        (tmp_path / "cut").write_bytes(whole[:length])
        assert "is damaged: " in refusal(tmp_path / "cut")


def test_a_ply_file_under_its_suffix_is_told_as_one(tmp_path):
    path = tmp_path / "splats.gsfw"
    path.write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    said = "FILE is a PLY file, despite its name.\nRename it to splats.ply."
    assert refusal(path) == said


def test_a_file_with_changed_bytes_is_refused_or_reads_the_same(tmp_path):
    path = written(tmp_path / "a")
    whole, before = path.read_bytes(), read_archive(path)
    refused = 0
    for position in range(0, len(whole), 41):
        changed = bytearray(whole)
        changed[position] ^= 0x55
        (tmp_path / "changed").write_bytes(changed)
        try:
            after = read_archive(tmp_path / "changed")
        except DataError:
            refused += 1
            continue
        # The bytes of an entry are checked; what is left are fields that nothing reads, and names.
        arrays = after.arrays.items()
        assert all(
            array.tobytes() == before.arrays[name].tobytes()
            for name, array in arrays
            if name in before.arrays
        )
    assert refused > 0.6 * len(whole) / 41


def test_a_missing_file_and_a_folder_are_told(tmp_path):
    assert refusal(tmp_path / "none") == "FILE cannot be read: No such file or directory."
    assert "cannot be read: Is a directory." in refusal(tmp_path)


def test_another_zip_is_told_apart(tmp_path):
    path = archive_of(tmp_path / "a.zip", [("readme.txt", "hello")])
    said = refusal(path)
    assert said.startswith(
        "FILE is no archive of arrays: it contains no header.json.\nGive a file that "
    )


HEADER = ("header.json", "{}")
BEGIN = "a does not begin as a .npy file of version 1.0 in C order does"


@pytest.mark.parametrize(
    ("entries", "problem"),
    [
        ([HEADER, ("a.npy", npy((2**40,)))], "of shape (1099511627776,) should have 4398046511104"),
        ([HEADER, ("a.npy", npy((2**62, 2**62)))], "should have"),
        ([HEADER, ("a.npy", npy((2,), body=b"1234"))], "should have 8 bytes, found 4"),
        ([HEADER, ("a.npy", npy((-1,), body=b""))], BEGIN),
        ([HEADER, ("a.npy", npy((1,), "|O", b"12345678"))], "a is of type |O, expected one of"),
        ([HEADER, ("a.npy", npy((1,), "<q9", b"12345678"))], "a is of type <q9, expected one of"),
        ([HEADER, ("a.npy", npy((1,), ">f4", b"1234"))], "a is of type >f4, expected one of"),
        ([HEADER, ("a.npy", npy((1,), "<f4", b"1234", order=True))], BEGIN),
        ([HEADER, ("a.npy", npy((1,), version=(2, 0)))], BEGIN),
        ([HEADER, ("a.npy", npy((1,), [("x", "<f4")], b"1234"))], BEGIN),
        ([HEADER, ("a.npy", b"cos\nsystem\n(S'true'\ntR.")], BEGIN),
        ([HEADER, ("a.npy", b"\x93NUMPY\x01\x00\x05\x00{[}[]")], BEGIN),
        ([("header.json", "[]")], "header.json holds a list, not an object"),
        ([("header.json", "{")], "is damaged: Expecting property name"),
        ([("header.json", b"\xff\xfe\xfd")], "is damaged: "),
        ([("header.json", "[" * 100_000)], "is damaged: "),
    ],
)  # fmt: skip
def test_hostile_content_is_refused_without_taking_its_word(tmp_path, entries, problem):
    assert problem in refusal(archive_of(tmp_path / "a", entries))


def test_compressed_entries_are_refused(tmp_path):
    bomb = [HEADER, ("a.npy", npy((2**22,), body=bytes(2**24)))]
    path = archive_of(tmp_path / "a", bomb, zipfile.ZIP_DEFLATED)
    assert path.stat().st_size < 2**16
    assert "header.json is compressed or encrypted, which none should be" in refusal(path)


def test_entries_that_share_their_bytes_or_name_are_refused(tmp_path):
    path = written(tmp_path / "a", {"first": np.zeros(1000), "other": np.zeros(1000)})
    whole = path.read_bytes()
    (tmp_path / "same").write_bytes(whole.replace(b"other.npy", b"first.npy"))
    assert "two of its entries have the same name" in refusal(tmp_path / "same")
    directory = whole.index(b"PK\x01\x02")
    offset = whole.rindex(b"PK\x01\x02", 0, whole.index(b"other.npy", directory)) + 42
    (tmp_path / "shared").write_bytes(
        whole[:offset] + struct.pack("<I", whole.index(b"PK\x03\x04", 10)) + whole[offset + 4 :]
    )
    assert "is damaged: " in refusal(tmp_path / "shared")


@pytest.mark.parametrize("sizes", [(2**31, 2**31), (2**31, 8128), (8128, 2**31)])
def test_sizes_beyond_those_of_the_file_are_refused(tmp_path, sizes):
    path = written(tmp_path / "a", {"first": np.zeros(1000)})
    whole = bytearray(path.read_bytes())
    entry = whole.rindex(b"PK\x01\x02")
    whole[entry + 20 : entry + 28] = struct.pack("<II", *sizes)
    path.write_bytes(whole)
    assert "its entries announce more bytes than the file has" in refusal(path)


def test_a_full_buffer_is_not_needed_to_refuse(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(io.BytesIO(b"PK\x05\x06" + bytes(18)).getvalue())
    said = refusal(path)
    assert said.startswith(
        "FILE is no archive of arrays: it contains no header.json.\nGive a file that "
    )
