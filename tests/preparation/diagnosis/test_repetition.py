"""Repetition, in databases of one image whose features are known."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from gsfw.preparation.diagnosis.evidence import Evidence
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.repetition import repeated_share
from gsfw.preparation.diagnosis.view_findings import repetition_findings
from gsfw.preparation.image_set import ImageSet

SHOWN = 100
"""Features of the image."""


def share(path: Path, distinct: int, step: float = 400.0) -> float:
    """What is measured of features that have so many different looks.

    Args:
        path: of a new database.
        distinct: looks of features, which take turns.
        step: pixels from one feature to the next of its look.
    """
    generator = np.random.default_rng(0)
    looks = generator.integers(0, 120, (distinct, 128)) * generator.integers(0, 2, (distinct, 128))
    number = np.arange(SHOWN)
    noise = generator.integers(0, 6, (SHOWN, 128))
    places = np.stack([step * (number // distinct), 5.0 * (number % distinct)], axis=1)
    with pycolmap.Database.open(path) as database:
        camera = pycolmap.Camera.create_from_model_name(1, "SIMPLE_PINHOLE", 900.0, 4000, 500)
        database.write_camera(camera, use_camera_id=True)
        image = pycolmap.Image(name="a", camera_id=1, image_id=1)
        database.write_image(image, use_image_id=True)
        database.write_keypoints(1, places.astype(np.float32))
        sift = pycolmap.FeatureExtractorType.SIFT
        data = (looks[number % distinct] + noise).astype(np.uint8)
        database.write_descriptors(1, pycolmap.FeatureDescriptors(type=sift, data=data))
        return repeated_share(database)


def test_features_that_an_image_shows_again_and_again_are_repeated(tmp_path: Path) -> None:
    assert share(tmp_path / "tiles.db", distinct=20) == 1.0
    assert share(tmp_path / "all.db", distinct=SHOWN) == 0.0
    assert share(tmp_path / "half.db", distinct=75) == pytest.approx(0.5)


def test_features_of_one_place_are_not_repeated(tmp_path: Path) -> None:
    assert share(tmp_path / "near.db", distinct=20, step=10.0) == 0.0


def test_a_database_without_images_repeats_nothing(tmp_path: Path) -> None:
    with pycolmap.Database.open(tmp_path / "empty.db") as database:
        assert repeated_share(database) == 0.0


def test_repeated_texture_is_told_with_its_share() -> None:
    graph = MatchGraph((), (), repeated=0.93)
    (finding,) = repetition_findings(Evidence(ImageSet(()), (), {}, graph, (), None))
    assert finding.kind == "repeated texture"
    assert finding.found.startswith("93 % of the features of an image have their like elsewhere")
    photo = Evidence(ImageSet(()), (), {}, MatchGraph((), (), repeated=0.11), (), None)
    assert list(repetition_findings(photo)) == []
