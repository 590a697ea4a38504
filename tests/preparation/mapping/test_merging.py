from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
from support.matched_captures import MatchedCapture, matched_capture, partial_model

from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.mapping.merging import adjusted, bridge_pairs, merge_models

RULE = MappingRule()


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> MatchedCapture:
    return matched_capture(tmp_path_factory.mktemp("whole"), 12)


def merged(
    capture: MatchedCapture, folder: Path, *groups: Sequence[int], turned: bool = True
) -> tuple[list[Any], int]:
    """Models of some of the images, each in coordinates of its own, after merging."""
    models = [partial_model(capture, folder / "parts", group) for group in groups]
    for number, model in enumerate(models):
        turn = pycolmap.Rotation3d(np.array([0.1, 0.5, 0.2]) * number * turned)
        model.transform(pycolmap.Sim3d(1.0 + number, turn, np.array([3.0, 0.0, 5.0]) * number))
    return merge_models(models, capture.database, folder, RULE)


@pytest.mark.parametrize("shared", [1, 2, 4])
def test_models_that_share_images_become_one_with_right_poses(
    capture: MatchedCapture, tmp_path: Path, shared: int
) -> None:
    models, joined = merged(capture, tmp_path, range(1, 8), range(8 - shared, 13))
    assert (len(models), joined) == (1, 1)
    assert sorted(models[0].reg_image_ids()) == list(range(1, 13))
    assert models[0].compute_mean_reprojection_error() < 0.65
    rotation, distance = capture.errors(models[0])
    assert rotation < 0.1
    assert distance < 0.002


@pytest.mark.slow
def test_a_model_may_join_by_what_another_one_brought(
    capture: MatchedCapture, tmp_path: Path
) -> None:
    models, joined = merged(capture, tmp_path, range(1, 6), range(8, 13), range(5, 9))
    assert (len(models), joined) == (1, 2)
    assert capture.errors(models[0])[0] < 0.1


def test_adjusting_a_model_prints_nothing(
    capture: MatchedCapture,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    model = partial_model(capture, tmp_path / "parts", range(1, 4))
    for name, value in (("alsologtostderr", False), ("logtostderr", False), ("stderrthreshold", 4)):
        monkeypatch.setattr(pycolmap.logging, name, value)
    capfd.readouterr()
    adjusted(model, RULE)
    assert capfd.readouterr() == ("", "")
    assert not pycolmap.logging.alsologtostderr


def test_models_that_share_nothing_stay_apart(capture: MatchedCapture, tmp_path: Path) -> None:
    models, joined = merged(capture, tmp_path, range(1, 8), range(8, 13))
    assert ([model.num_reg_images() for model in models], joined) == ([7, 5], 0)


def test_a_model_of_images_that_the_largest_has_disappears(
    capture: MatchedCapture, tmp_path: Path
) -> None:
    models, joined = merged(capture, tmp_path, range(1, 13), range(3, 9))
    assert ([model.num_reg_images() for model in models], joined) == ([12], 1)


@pytest.mark.slow
def test_models_whose_matches_deny_that_they_belong_together_stay_apart(tmp_path: Path) -> None:
    # Of two other scenes, whose images have the same names: the shared one fits neither.
    (tmp_path / "one").mkdir()
    (tmp_path / "other").mkdir()
    one = matched_capture(tmp_path / "one", 12)
    other = matched_capture(tmp_path / "other", 12, seed=1)
    models = [
        partial_model(one, tmp_path / "parts", range(1, 8)),
        partial_model(other, tmp_path / "parts", range(7, 13)),
    ]
    left, joined = merge_models(models, one.database, tmp_path, RULE)
    assert ([model.num_reg_images() for model in left], joined) == ([7, 6], 0)
    assert left[0] is models[0]


def test_the_pairs_that_may_bridge_models_come_most_promising_first(tmp_path: Path) -> None:
    capture = matched_capture(
        tmp_path, 9, linked=lambda first, second: (first < 5) == (second < 5) or first == 2
    )
    database = pycolmap.Database.open(capture.database)
    database.delete_two_view_geometry(2, 8)
    database.close()
    # Images 2 and 8 look alike, but are not verified; image 2 is linked to 5, 6, 7 and 9.
    model = partial_model(capture, tmp_path / "parts", range(5, 10))
    folder = tmp_path / "0"
    folder.mkdir()
    model.write(folder)
    names = {number: image.name for number, image in capture.truth.images.items()}
    pairs = bridge_pairs(capture.database, [folder])
    assert pairs[0] == (names[8], names[2])
    assert pairs[1] == (names[5], names[4])
    assert len(pairs) == 5 * 4 - 4
    assert bridge_pairs(capture.database, [folder], most=3) == pairs[:3]
    assert bridge_pairs(capture.database, []) == ()
