"""NumPy's files are read whole or refused, in any thread."""

import zipfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from support.reader_faults import little_memory

from gsfw.core.errors import DataError
from gsfw.core.files.array_file import array_header, read_array, read_numbers


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("name", ["a.npy", "a.npz"])
def test_arrays_come_back_in_both_orders(tmp_path, name, order):
    values = np.asarray(np.arange(24.0, dtype=np.float32).reshape(2, 3, 4), order=order)
    (np.save if name == "a.npy" else np.savez)(tmp_path / name, values)
    found = read_array(tmp_path / name)
    assert np.array_equal(found, values)
    assert found.flags.writeable
    header = array_header(tmp_path / name)
    assert (header.shape, header.dtype) == ((2, 3, 4), np.float32)


def test_many_threads_may_read_at_a_time(tmp_path):
    np.save(tmp_path / "a.npy", np.ones((3, 2)))
    with ThreadPoolExecutor(8) as threads:
        found = threads.map(lambda _: read_array(tmp_path / "a.npy").sum(), range(400))
        assert set(found) == {6.0}


def test_files_that_are_cut_off_or_hold_objects_are_refused(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.ones(100))
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(DataError, match="it is cut off"):
        read_array(path)
    np.save(path, np.array([{}]), allow_pickle=True)
    with pytest.raises(DataError, match="it holds Python objects, not numbers"):
        read_array(path)
    with pytest.raises(DataError, match=r"nowhere\.npy cannot be read"):
        array_header(tmp_path / "nowhere.npy")


def lying(path, shape, kind=b"'<f8'"):
    """A file whose header announces values that it does not have."""
    header = b"{'descr': %s, 'fortran_order': False, 'shape': %s, }" % (kind, shape)
    header = header.ljust(117) + b"\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + bytes(64))
    return path


@pytest.mark.parametrize(
    ("shape", "kind", "words"),
    [
        (b"(1000000000000,)", b"'<f8'", "it is cut off, or its header is damaged"),
        (b"(4294967296, 4294967296)", b"'<f8'", "it is cut off, or its header is damaged"),
        (b"(-1, 8)", b"'<f8'", r"its shape is \(-1, 8\)"),
        (b"(((8,)", b"'<f8'", "its header is damaged"),
        (b"(8,)", b"'<q8'", "its header is damaged"),
    ],
)
def test_a_header_that_announces_more_than_the_file_has_gets_no_memory(
    tmp_path, shape, kind, words
):
    with little_memory(), pytest.raises(DataError, match=words):
        read_array(lying(tmp_path / "a.npy", shape, kind))


def test_a_header_that_announces_its_own_length_gets_no_memory_for_it(tmp_path):
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\x02\x00\xff\xff\xff\x7f" + b" " * 40_000)
    with little_memory(), pytest.raises(DataError, match="its header is damaged"):
        read_array(tmp_path / "a.npy")


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_an_archive_whose_header_lies_gets_no_memory(tmp_path, method):
    inner = lying(tmp_path / "a.npy", b"(1000000000000,)").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.npz", "w", method) as archive:
        archive.writestr("a.npy", inner)
    with little_memory(), pytest.raises(DataError, match="cannot be read"):
        read_array(tmp_path / "a.npz")


def test_an_array_of_an_archive_is_found_by_its_name(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", first=np.zeros(3), data=np.zeros((2000, 300), np.int16))
    assert read_numbers(tmp_path / "a.npz", "data").shape == (2000, 300)
    with pytest.raises(DataError, match="it contains no array 'other'"):
        read_numbers(tmp_path / "a.npz", "other")
    np.save(tmp_path / "a.npy", np.array(["text"]))
    with pytest.raises(DataError, match="holds values of type <U4"):
        read_numbers(tmp_path / "a.npy")


def test_a_signalling_nan_is_a_nan_without_a_warning(tmp_path):
    path = tmp_path / "a.npy"
    np.save(path, np.array([0x7FA00000], np.uint32).view(np.float32))
    assert np.isnan(read_numbers(path)).all()
