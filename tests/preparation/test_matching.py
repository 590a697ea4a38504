import shutil
import sqlite3
from contextlib import closing
from itertools import combinations
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from support import captured

from gsfw.core.errors import DataError
from gsfw.preparation import matching
from gsfw.preparation.features import FeatureSettings, extract_features
from gsfw.preparation.match_list import MARK, listable, listable_names
from gsfw.preparation.matching import forget_matches, match_more, match_pairs
from gsfw.preparation.pairs import PairPlan

COUNT = 5
SIZE = (240, 180)


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> Path:
    """A database with features of a few images; two names have spaces, one begins with #."""
    pycolmap.logging.minloglevel = 2
    folder = tmp_path_factory.mktemp("found")
    views = captured.photos(captured.arc(COUNT, step=8.0, width=SIZE[0], height=SIZE[1]))
    paths = list(captured.write(folder / "photos", views))
    for number, name in enumerate(("#1.png", "in the  garden.png", "left over.png")):
        paths[number] = paths[number].rename(paths[number].with_name(name))
    images = captured.image_set(paths)
    settings = FeatureSettings(max_size=240, count=600, jobs=1)
    groups = captured.one_group(images, 250.0)
    extract_features(folder / "d.db", images, groups, settings)
    return folder / "d.db"


@pytest.fixture
def database(found, tmp_path) -> Path:
    return Path(shutil.copy(found, tmp_path / "d.db"))


def names(database: Path) -> list[str]:
    with pycolmap.Database.open(database) as opened:
        return [image.name for image in opened.read_all_images()]


def every_pair(database: Path) -> PairPlan:
    return PairPlan(tuple(combinations(names(database), 2)), "")


def inliers(database: Path) -> dict[tuple[int, int], np.ndarray]:
    """Verified matches of each pair that was looked at."""
    with pycolmap.Database.open(database) as opened:
        return {
            (first, second): opened.read_two_view_geometry(first, second).inlier_matches
            for first, second in combinations(range(1, COUNT + 1), 2)
            if opened.exists_two_view_geometry(first, second)
        }


def assert_same(one: dict, other: dict) -> None:
    assert one.keys() == other.keys()
    assert all(np.array_equal(one[pair], other[pair]) for pair in one)


@pytest.fixture(scope="module")
def all_matches(found, tmp_path_factory) -> dict[tuple[int, int], np.ndarray]:
    database = Path(shutil.copy(found, tmp_path_factory.mktemp("all") / "d.db"))
    match_pairs(database, every_pair(database), 1)
    return inliers(database)


@pytest.mark.slow
def test_neighbours_have_many_verified_matches_and_names_stay_as_they_were(found, database):
    match_pairs(database, every_pair(database), 1)
    matches = inliers(database)
    assert len(matches) == COUNT * (COUNT - 1) // 2
    assert all(len(matches[(number, number + 1)]) > 100 for number in range(1, COUNT))
    assert names(database) == names(found)
    assert sorted(path.name for path in database.parent.iterdir()) == ["d.db"]


def test_matches_lie_on_the_epipolar_lines_of_the_true_cameras(found, all_matches):
    cameras = captured.arc(COUNT, step=8.0, width=SIZE[0], height=SIZE[1])
    first, second = (pose.numpy() for pose in cameras.world_to_camera[:2])
    matrix = cameras.intrinsics[0].numpy()
    relative = second @ np.linalg.inv(first)
    x, y, z = relative[:3, 3]
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    essential = cross @ relative[:3, :3]
    fundamental = np.linalg.inv(matrix).T @ essential @ np.linalg.inv(matrix)
    with pycolmap.Database.open(found) as opened:
        one, other = (opened.read_keypoints(number)[:, :2] for number in (1, 2))
    left, right = all_matches[(1, 2)].T
    lines = np.c_[one[left], np.ones(len(left))] @ fundamental.T
    distances = np.abs((np.c_[other[right], np.ones(len(right))] * lines).sum(1))
    distances /= np.linalg.norm(lines[:, :2], axis=1)
    assert np.median(distances) < 0.2
    assert (distances < 1.5).mean() > 0.95


def test_matches_do_not_depend_on_threads_or_blocks(database, all_matches, monkeypatch):
    monkeypatch.setattr(matching, "BLOCK", 3)
    match_pairs(database, every_pair(database), 2)
    assert_same(inliers(database), all_matches)


def test_pairs_that_are_there_are_not_matched_again(database, all_matches, monkeypatch):
    plan = every_pair(database)
    match_pairs(database, PairPlan(plan.pairs[:4], ""), 1)
    assert len(inliers(database)) == 4
    matched = []
    really = matching._match
    monkeypatch.setattr(
        matching,
        "_match",
        lambda path, pairs, *rest: (matched.extend(pairs), really(path, pairs, *rest)),
    )
    # Turned around, twice, with itself, and with an image that is not there: still the same.
    more = tuple((second, first) for first, second in plan.pairs)
    odd = ((plan.pairs[0][0], plan.pairs[0][0]), (plan.pairs[0][0], "missing.png"))
    match_pairs(database, PairPlan((*more, *plan.pairs, *odd), ""), 1)
    assert set(matched) == set(plan.pairs[4:])
    assert_same(inliers(database), all_matches)


def test_names_are_restored_after_a_process_was_killed(found, database, all_matches):
    with closing(sqlite3.connect(database)) as opened:
        marked = [(listable(name), name) for name in names(database)]
        opened.executemany("update images set name = ? where name = ?", marked)
        opened.commit()
    assert any(name.startswith(MARK) for name in names(database))
    match_pairs(database, every_pair(found), 1)
    assert names(database) == names(found)
    assert_same(inliers(database), all_matches)


def test_the_list_of_pairs_of_a_killed_process_is_replaced_and_removed(database):
    plan = every_pair(database)
    left = database.with_name(f"{database.stem}_pairs.txt")
    for _ in range(2):  # The second time all pairs are there.
        left.write_text("half of a li")
        match_pairs(database, plan, 1)
        assert not left.exists()
    assert inliers(database)
    assert not list(database.parent.glob("pairs_*"))


def test_names_are_restored_after_an_interruption(found, database):
    def interrupted() -> None:
        with listable_names(database):
            assert all(" " not in name and not name.startswith("#") for name in names(database))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert names(database) == names(found)


def test_matching_more_finds_more_in_pairs_that_were_there(database, all_matches):
    plan = every_pair(database)
    match_pairs(database, plan, 1)
    match_more(database, plan.pairs[:2], 1)
    more = inliers(database)
    assert more.keys() == all_matches.keys()
    for number, pair in enumerate(all_matches):
        assert (len(more[pair]) > len(all_matches[pair])) == (number < 2)


def test_forgetting_matches_keeps_the_features(found, database, all_matches):
    match_pairs(database, every_pair(database), 1)
    forget_matches(database)
    assert inliers(database) == {}
    with pycolmap.Database.open(database) as one, pycolmap.Database.open(found) as other:
        assert one.num_keypoints() == other.num_keypoints() > 1000
    forget_matches(database.with_name("missing.db"))
    assert not database.with_name("missing.db").exists()


def test_a_file_that_is_no_database_is_refused(tmp_path):
    path = tmp_path / "d.db"
    path.write_text("something else")
    with pytest.raises(DataError, match="COLMAP could not match features with"):
        match_pairs(path, PairPlan((), ""), 1)


@pytest.mark.slow
def test_all_photos_of_the_shared_capture_register(tmp_path):
    database, images, cameras = captured.database(tmp_path, n=6)
    (tmp_path / "models").mkdir()
    pycolmap.set_random_seed(0)
    models = pycolmap.incremental_mapping(database, tmp_path / "photos", tmp_path / "models")
    assert [model.num_reg_images() for model in models.values()] == [6]
    assert len(images.images) == len(cameras.world_to_camera) == 6
    focal = next(iter(models[0].cameras.values())).focal_length
    assert focal == pytest.approx(captured.FOCAL, rel=0.03)
