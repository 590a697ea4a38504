"""Lenses that come out impossible, and what takes their place."""

import json
from dataclasses import replace

import pycolmap
import pytest
from support import captured
from support.matched_captures import matched_capture

from gsfw.commands.main import main
from gsfw.preparation import camera_grouping, feature_search
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.mapping import mapping
from gsfw.preparation.simpler_lenses import (
    impossible_lenses,
    set_lenses,
    what_changes,
    with_simpler_lenses,
)

GROUP = CameraGroup(1, "OPENCV", 64, 48, 70.0, "EXIF", ("a.png", "b.png"))


def test_only_cameras_that_failed_get_the_next_simpler_lens():
    groups = (GROUP, replace(GROUP, number=2), replace(GROUP, number=3, model="SIMPLE_RADIAL"))
    found = with_simpler_lenses(groups, {2: "folds", 3: "folds"})
    assert [group.model for group in found] == ["OPENCV", "SIMPLE_RADIAL", "SIMPLE_PINHOLE"]
    pinhole = (replace(GROUP, model="SIMPLE_PINHOLE"),)
    assert with_simpler_lenses(pinhole, {1: "folds"}) == pinhole


def test_one_line_says_what_is_computed_again():
    after = with_simpler_lenses((GROUP,), {1: "folds"})
    assert what_changes((GROUP,), after) == (
        "cameras: the distortion of camera 1 (2 images) came out impossible with OPENCV; computing "
        "again with SIMPLE_RADIAL, from the same features and matches"
    )


def test_a_database_gets_the_lens_and_keeps_its_matches(tmp_path):
    database = matched_capture(tmp_path, images=3).database
    group = replace(GROUP, model="SIMPLE_PINHOLE", width=1024, height=768, focal=900.0)

    def content():
        with pycolmap.Database.open(database) as opened:
            matches = opened.num_inlier_matches(), opened.num_keypoints()
            return opened.read_all_cameras(), matches

    before, matches = content()
    set_lenses(database, [group, replace(group, number=99)])
    cameras, after = content()
    assert after == matches
    assert len(cameras) == len(before)
    changed = {camera.camera_id: camera for camera in cameras}[1]
    assert (changed.model_name, changed.params.tolist()) == ("SIMPLE_PINHOLE", [900, 512, 384])
    assert changed.has_prior_focal_length


def bent(model: pycolmap.Reconstruction) -> None:
    """Give the lens a distortion that folds the image over, if it has any coefficient."""
    for camera in model.cameras.values():
        params = camera.params
        if len(params) > 3:
            params[-1 if len(params) == 4 else 4] = -0.9
            camera.params = params


@pytest.mark.slow
@pytest.mark.parametrize(("few", "tried"), [(20, 2), (5, 3)])
def test_an_impossible_lens_is_computed_again_more_simply(
    tmp_path, monkeypatch, capsys, few, tried
):
    photos, out = tmp_path / "photos", tmp_path / "scene"
    captured.write(photos, captured.photos(captured.arc(9)), ".jpg")
    monkeypatch.setattr(camera_grouping, "FEW", few)
    map_cameras, find_features = mapping.map_cameras, feature_search.find_features
    found: list[str] = []
    mapped: list[str] = []

    def map_badly(database, folder, rule):
        result = map_cameras(database, folder, rule)
        model = pycolmap.Reconstruction(result.models[0])
        mapped.extend(camera.model_name for camera in model.cameras.values())
        bent(model)
        model.write(result.models[0])
        return result

    def find(task):
        found.append(task.name)
        return find_features(task)

    monkeypatch.setattr(mapping, "map_cameras", map_badly)
    monkeypatch.setattr(feature_search, "find_features", find)
    command = ["prepare", str(photos), f"out={out}", "jobs=1"]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert mapped == ["OPENCV", "SIMPLE_RADIAL", "SIMPLE_PINHOLE"][-tried:]
    assert len(found) == 9, "features are found once"
    assert said.count("came out impossible with ") == tried - 1
    assert said.count("matches: ") <= 1
    report = json.loads((out / "prepare.json").read_text())
    assert "computing again with SIMPLE_PINHOLE" in report["chosen"]["lenses"]
    assert len(report["registered"]) == 9
    assert impossible_lenses(out / "sparse" / "0") == {}
    # The same command has nothing left to do.
    assert main(command) == 0
    assert len(mapped) == tried
    assert json.loads((out / "prepare.json").read_text())["registered"] == report["registered"]


@pytest.mark.slow
def test_a_lens_model_that_was_given_is_kept_and_refused_in_words(tmp_path, monkeypatch, capsys):
    photos = tmp_path / "photos"
    captured.write(photos, captured.photos(captured.arc(9)), ".jpg")
    map_cameras = mapping.map_cameras

    def map_badly(database, folder, rule):
        result = map_cameras(database, folder, rule)
        model = pycolmap.Reconstruction(result.models[0])
        bent(model)
        model.write(result.models[0])
        return result

    monkeypatch.setattr(mapping, "map_cameras", map_badly)
    command = ["prepare", str(photos), f"out={tmp_path / 'scene'}", "jobs=1"]
    assert main([*command, "camera_model=SIMPLE_RADIAL"]) == 2
    assert "folds the image over" in capsys.readouterr().err
