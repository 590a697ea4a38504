from pathlib import Path

import numpy as np
import pycolmap
import pytest
from support import captured

from gsfw.core.errors import ConfigError
from gsfw.preparation.features import FeatureSettings, extract_features
from gsfw.preparation.retrieval import build_vocabulary, check_vocabulary, look_alikes

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow

COUNT = 10
STEP = 14.0
"""Degrees: the first and the last image show little that is the same."""


@pytest.fixture(scope="module")
def arc(tmp_path_factory) -> Path:
    """A database with features of images from around the scene."""
    pycolmap.logging.minloglevel = 2
    folder = tmp_path_factory.mktemp("arc")
    views = captured.photos(captured.arc(COUNT, step=STEP, width=240, height=180))
    images = captured.image_set(captured.write(folder / "photos", views))
    settings = FeatureSettings(max_size=240, count=800, jobs=1)
    extract_features(folder / "d.db", images, captured.one_group(images), settings)
    return folder / "d.db"


@pytest.fixture(scope="module")
def vocabulary(tmp_path_factory) -> Path:
    """A vocabulary of random features."""
    path = tmp_path_factory.mktemp("words") / "words.bin"
    features = np.random.default_rng(0).integers(0, 255, (3000, 128)).astype(np.float32)
    build_vocabulary(path, features)
    return path


def test_neighbours_are_the_most_alike(arc):
    ranked = look_alikes(arc, None)
    assert len(ranked) == COUNT
    hits, expected = 0, 0
    for name, others in ranked.items():
        assert name not in others
        assert len(set(others)) == len(others)
        number = int(name[6:9])
        near = {f"photo_{number + step:03d}.png" for step in (-1, 1)} & set(ranked)
        hits, expected = hits + len(near & set(others[:4])), expected + len(near)
    # By chance, 4 of 9 would be found.
    assert hits >= 0.85 * expected


def test_the_same_features_give_the_same_order(arc):
    assert look_alikes(arc, None) == look_alikes(arc, None)


def test_nothing_is_left_beside_the_database(arc):
    before = sorted(arc.parent.iterdir())
    look_alikes(arc, None)
    assert sorted(arc.parent.iterdir()) == before


def test_a_vocabulary_can_be_given(arc, vocabulary):
    assert len(look_alikes(arc, vocabulary)) == COUNT


def test_too_few_features_for_a_vocabulary_give_no_look_alikes(tmp_path):
    images = captured.image_set(
        captured.write(tmp_path / "photos", [np.full((60, 80, 3), 90, np.uint8)] * 2)
    )
    groups = captured.one_group(images)
    extract_features(tmp_path / "d.db", images, groups, FeatureSettings())
    assert look_alikes(tmp_path / "d.db", None) == {}


def test_building_a_vocabulary_says_nothing(capfd, tmp_path):
    features = np.random.default_rng(0).integers(0, 255, (2600, 128)).astype(np.float32)
    build_vocabulary(tmp_path / "words.bin", features)
    assert capfd.readouterr() == ("", "")
    check_vocabulary(tmp_path / "words.bin")


def test_a_file_that_is_no_vocabulary_is_refused(tmp_path, vocabulary):
    advice = (
        "\nExpected a vocabulary tree of COLMAP 3.12 or later (faiss) for SIFT features; leave it "
        "out to build one of the images themselves."
    )
    path = tmp_path / "tree.bin"
    path.write_bytes(bytes(range(250)) * 10)
    with pytest.raises(ConfigError) as caught:
        check_vocabulary(path)
    assert str(caught.value) == (
        f"vocabulary={path} is a vocabulary of COLMAP before 3.12 (flann), or none at all.{advice}"
    )
    path.write_bytes(vocabulary.read_bytes()[:2000])
    with pytest.raises(ConfigError) as caught:
        check_vocabulary(path)
    assert str(caught.value) == f"vocabulary={path} is damaged or no vocabulary.{advice}"
