from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from gsfw.core.errors import DataError
from gsfw.datamanagers.images import Header
from gsfw.preparation.diagnosis.link import JOINED, Link
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.exif import Exif
from gsfw.preparation.image_set import ImageSet, SourceImage

FLAT = int(pycolmap.TwoViewGeometryConfiguration.PLANAR_OR_PANORAMIC)
DEEP = int(pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED)


def images(*names: str) -> ImageSet:
    header = Header(1000, 500, False)
    return ImageSet(tuple(SourceImage(name, Path(name), header, Exif()) for name in names))


def graph(names: str, *links: tuple[str, str, int, int]) -> MatchGraph:
    return MatchGraph(tuple(names), tuple(Link(*link) for link in links))


def write(
    path: Path, places: list[np.ndarray], kind: int, homography: np.ndarray | None = None
) -> None:
    """Images whose features all match, one to one."""
    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_RADIAL", 900.0, 1000, 500)
        database.write_camera(camera, use_camera_id=True)
        rows = np.arange(len(places[0]), dtype=np.uint32)
        matches = np.stack([rows, rows], 1)
        for number, place in enumerate(places, 1):
            image = pycolmap.Image(name="abc"[number - 1], camera_id=1, image_id=number)
            database.write_image(image, use_image_id=True)
            database.write_keypoints(number, place.astype(np.float32))
        for first in range(1, len(places)):
            database.write_matches(first, first + 1, matches)
            motion = pycolmap.TwoViewGeometry()
            motion.config, motion.inlier_matches = kind, matches
            if homography is not None:
                motion.H = homography
            database.write_two_view_geometry(first, first + 1, motion)


@pytest.fixture
def places() -> np.ndarray:
    return np.random.default_rng(0).uniform(0, (1000, 500), (40, 2))


def turned(places: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Where a camera sees the same after a turn, and perhaps a step sideways before a wall."""
    matrix = np.array([[900.0, 0, 500], [0, 900, 250], [0, 0, 1]])
    c, s = np.cos(0.1), np.sin(0.1)
    motion = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ (np.eye(3) + [[0, 0, step]] * 3)
    homography = matrix @ motion @ np.linalg.inv(matrix)
    seen = np.hstack([places, np.ones((len(places), 1))]) @ homography.T
    return seen[:, :2] / seen[:, 2:], homography


def test_links_tell_matches_and_how_far_they_move(tmp_path, places):
    path = tmp_path / "database.db"
    write(path, [places, places + np.array([30, 40])], DEEP)
    (link,) = MatchGraph.read(path, images("a", "b", "c")).links
    assert (link.first, link.second, link.matches, link.verified) == ("a", "b", 40, 40)
    assert link.shift == pytest.approx(0.05, abs=1e-6)
    assert link.joins
    assert not link.flat
    assert not link.is_still


def test_a_camera_that_turned_is_told_from_one_that_moved_before_a_wall(tmp_path, places):
    links = []
    sideways = np.array([[1.0, 0, 90], [0, 1, 0], [0, 0, 1]])
    motions = (turned(places, 0.0), turned(places, 0.2), (places + np.array([90, 0]), sideways))
    for number, (seen, homography) in enumerate(motions):
        path = tmp_path / f"{number}.db"
        write(path, [places, seen], FLAT, homography)
        links += MatchGraph.read(path, images("a", "b")).links
    assert [link.flat for link in links] == [True, True, True]
    assert [link.is_turn for link in links] == [True, False, False]


def test_a_view_that_is_the_same_is_still_and_no_turn(tmp_path, places):
    path = tmp_path / "database.db"
    write(path, [places, places + 0.2], FLAT, np.eye(3))
    (link,) = MatchGraph.read(path, images("a", "b")).links
    assert link.is_still
    assert not link.is_turn


def test_what_stays_in_place_while_the_view_moves_is_told(tmp_path, places):
    later = places + np.array([50, 0])
    later[:10] = places[:10]
    path = tmp_path / "database.db"
    write(path, [places, later], DEEP)
    found = MatchGraph.read(path, images("a", "b"))
    assert found.still == pytest.approx(0.25)
    assert found.has_overlay
    assert not replace(found, still=0.05).has_overlay


def test_without_a_database_there_are_no_links(tmp_path):
    found = MatchGraph.read(tmp_path / "database.db", images("a", "b"))
    assert found == MatchGraph(("a", "b"), ())
    assert found.components() == ()
    assert found.bridges(()) == ()
    assert not (tmp_path / "database.db").exists()


def test_a_damaged_database_is_named(tmp_path):
    path = tmp_path / "database.db"
    path.write_bytes(b"no database" * 1000)
    with pytest.raises(DataError) as raised:
        MatchGraph.read(path, images("a", "b"))
    assert raised.value.message.startswith(f"COLMAP could not read the matches with {path}: ")


def test_components_are_joined_through_others_and_by_enough_matches():
    found = graph(
        "abcdefg",
        ("a", "b", 50, 40),
        ("b", "d", 50, JOINED),
        ("c", "e", 90, 80),
        ("d", "e", 30, JOINED - 1),
        ("f", "g", 20, 0),
    )
    first, second = found.components(placed=["c", "e"])
    assert (first.images, first.placed) == (("c", "e"), 2)
    assert (second.images, second.placed) == (("a", "b", "d"), 0)


def test_the_best_link_has_most_verified_matches():
    found = graph("abc", ("a", "b", 90, 20), ("a", "c", 50, 30))
    assert found.best("a").other("a") == "c"
    assert found.best("a", among=["b"]).other("a") == "b"
    assert found.best("b", among=["c"]) is None


def test_bridges_lead_from_group_to_group_where_they_come_nearest():
    found = graph(
        "abcdef",
        ("a", "b", 90, 80),
        ("c", "d", 90, 80),
        ("e", "f", 90, 80),
        ("b", "e", 40, 0),
        ("a", "f", 20, 0),
    )
    first, second = found.bridges(found.components())
    assert first.advice == (
        "take photos between b and e (40 features look alike, but fit no motion of a camera)"
    )
    assert second.advice == "take photos between b and c (nearest to each other by name)"


def test_panoramas_are_missing_between_the_panoramas_of_views():
    found = replace(graph("abcd"), shots={"a": "/p.jpg", "b": "/p.jpg", "c": "/q.jpg"})
    assert found.bridge(("a", "b"), ("c",)).advice == (
        "take panoramas between p.jpg and q.jpg (nearest to each other by name)"
    )
    assert found.between("c", "d") == "photos between q.jpg and d"
    assert found.between("c", "others") == "panoramas between q.jpg and others"
