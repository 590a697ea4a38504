"""Disks that are full, which COLMAP's database must not notice first."""

from types import SimpleNamespace

import numpy as np
import pytest
from support import captured

from gsfw.core.errors import OutputError
from gsfw.preparation import disk
from gsfw.preparation.features import FeatureSettings, extract_features
from gsfw.preparation.matching import match_pairs
from gsfw.preparation.pairs import PairPlan


@pytest.fixture
def full(monkeypatch):
    """A disk that is full from the given look on."""

    def from_look(first: int) -> None:
        looks = iter([disk.ROOM] * first + [5_400_000] * 9)
        usage = SimpleNamespace(disk_usage=lambda path: SimpleNamespace(free=next(looks)))
        monkeypatch.setattr(disk, "shutil", usage)

    return from_look


@pytest.mark.parametrize("looks", [0, 1, 2])
def test_features_are_not_written_to_a_full_disk(tmp_path, full, looks):
    grey = np.full((48, 64, 3), 128, np.uint8)
    images = captured.image_set(captured.write(tmp_path / "photos", [grey, grey // 2]))
    database = tmp_path / "d.db"
    full(looks)
    with pytest.raises(OutputError) as caught:
        extract_features(database, images, captured.one_group(images), FeatureSettings())
    assert str(caught.value) == (
        f"the disk is nearly full: {database} may need 32 MB more, and 5 MB are free.\n"
        "Free some space, and the same command continues; or choose another folder: out=DIR."
    )


def test_a_limit_of_the_size_of_files_is_named(tmp_path):
    resource = pytest.importorskip("resource")
    database = tmp_path / "d.db"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (32_000_500, before[1]))
    try:
        disk.check_room(database)
        database.write_bytes(bytes(1000))
        with pytest.raises(OutputError) as caught:
            disk.check_room(database)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert str(caught.value) == (
        f"files of this process may have at most 32.0 MB (ulimit -f), and {database} may "
        "need 32 MB.\n"
        "Raise the limit, and the same command continues."
    )


def test_matches_are_not_written_to_a_full_disk(tmp_path, full):
    full(0)
    with pytest.raises(OutputError, match="the disk is nearly full"):
        match_pairs(tmp_path / "d.db", PairPlan((), ""), 1)
