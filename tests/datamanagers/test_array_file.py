"""NumPy's files are read whole or refused, in any thread."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from gsfw.core.errors import DataError
from gsfw.datamanagers.array_file import array_header, read_array


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
