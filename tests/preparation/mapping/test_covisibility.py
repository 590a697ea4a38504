from pathlib import Path

import numpy as np
import pycolmap
import pytest
from support.matched_captures import matched_capture, partial_model

from gsfw.preparation.mapping import mapping as mapping_module
from gsfw.preparation.mapping.mapping import map_cameras
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.mapping.observations import Observations, cut_loose, held_together


def test_images_that_see_the_same_points_hold_each_other(tmp_path: Path) -> None:
    model = matched_capture(tmp_path, 6).truth
    assert held_together(Observations.of(model)) == set(range(1, 7))
    assert cut_loose(model) == 0
    assert model.num_reg_images() == 6


def test_a_model_without_images_holds_none() -> None:
    assert held_together(Observations.of(pycolmap.Reconstruction())) == set()


def test_a_group_that_sees_nothing_with_the_others_loses_its_poses(tmp_path: Path) -> None:
    model = matched_capture(tmp_path, 7).truth
    for number, point in list(model.points3D.items()):
        seen = [(element.image_id, element.point2D_idx) for element in point.track.elements]
        for image, feature in seen:
            if (image < 4) == (number % 2 == 0):
                model.delete_observation(image, feature)
    assert held_together(Observations.of(model)) == {4, 5, 6, 7}
    assert cut_loose(model) == 3
    assert set(model.reg_image_ids()) == {4, 5, 6, 7}


def test_what_global_mapping_placed_anywhere_is_placed_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = matched_capture(tmp_path, 9)
    model = partial_model(capture, tmp_path / "part", range(1, 8))
    monkeypatch.setattr(mapping_module, "run_global", lambda *arguments: [model])
    # Two images that see hardly any points are turned away from where they belong.
    for number in (6, 7):
        for feature in model.image(number).get_observation_point2D_idxs()[5:]:
            model.delete_observation(number, feature)
        turn = pycolmap.Rotation3d(np.array([0.0, 0.7, 0.0]))
        pose = model.image(number).cam_from_world()
        turned = pycolmap.Rigid3d(turn * pose.rotation, pose.translation)
        model.frame(model.image(number).frame_id).rig_from_world = turned
    rule = MappingRule(mapper="global")
    mapping = map_cameras(capture.database, tmp_path / "models", rule)
    assert mapping.sizes == (9,)
    assert mapping.how == (
        "global mapping (GLOMAP), with 2 images placed anew by incremental mapping"
    )
    rotation, distance = capture.errors(pycolmap.Reconstruction(mapping.models[0]))
    assert rotation < 0.1
    assert distance < 0.002


def test_images_of_other_global_models_are_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = matched_capture(tmp_path, linked=lambda first, second: (first <= 6) == (second <= 6))
    large = partial_model(capture, tmp_path / "large", range(1, 7))
    small = partial_model(capture, tmp_path / "small", range(7, 11))
    for feature in large.image(6).get_observation_point2D_idxs()[5:]:
        large.delete_observation(6, feature)
    monkeypatch.setattr(mapping_module, "run_global", lambda *_: [large, small])
    mapping = map_cameras(capture.database, tmp_path / "models", MappingRule(mapper="global"))
    assert mapping.how.endswith("with 1 images placed anew by incremental mapping")
    assert mapping.sizes == (6, 4)
