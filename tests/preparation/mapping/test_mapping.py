import _thread
import json
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from support import captured
from support.matched_captures import MatchedCapture, matched_capture, pose_errors
from support.watched_stages import WatchedStages

from gsfw.core.errors import DataError
from gsfw.core.progress import shown_by
from gsfw.preparation.mapping.incremental_mapping import LEAST_POINTS, solid
from gsfw.preparation.mapping.mapping import Mapping, continue_mapping, map_cameras
from gsfw.preparation.mapping.mapping_rule import MappingRule

# Seconds each; .ci/run runs them.
pytestmark = pytest.mark.slow

RULE = MappingRule()
SHARED_DATA = Path(__file__).resolve().parents[4] / "shared" / "data"


def poses(model: Path) -> dict[str, np.ndarray]:
    images = pycolmap.Reconstruction(model).images.values()
    return {image.name: image.cam_from_world().matrix() for image in images}


def content(database: Path) -> list[str]:
    with closing(sqlite3.connect(database)) as opened:
        return list(opened.iterdump())


@pytest.fixture(scope="module")
def ten(tmp_path_factory: pytest.TempPathFactory) -> MatchedCapture:
    return matched_capture(tmp_path_factory.mktemp("ten"))


@pytest.fixture(scope="module")
def fox(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A database of ten of the fox photos, reduced, and the model that came with them."""
    capture = SHARED_DATA / "captures" / "fox"
    if not capture.is_dir():
        pytest.skip("the folder of real captures is not on this machine")
    path = tmp_path_factory.mktemp("fox") / "database.db"
    names = sorted(photo.name for photo in (capture / "images").iterdir())
    extraction = pycolmap.FeatureExtractionOptions()
    extraction.max_image_size, extraction.sift.max_num_features = 480, 1000
    pycolmap.extract_features(
        path,
        capture / "images",
        names[20:40:2],
        pycolmap.CameraMode.SINGLE,
        extraction_options=extraction,
    )
    pycolmap.match_exhaustive(path)
    return path, capture / "sparse" / "0"


def test_all_images_get_their_poses_up_to_a_similarity(ten: MatchedCapture, tmp_path: Path) -> None:
    watched = WatchedStages()
    with shown_by(watched.show):
        mapping = map_cameras(ten.database, tmp_path / "models", RULE)
    assert mapping.sizes == (10,)
    assert mapping.models == (tmp_path / "models" / "0",)
    assert mapping.merged == 0
    assert mapping.seconds > 0
    assert mapping.how == "incremental mapping (COLMAP)"
    rotation, distance = ten.errors(pycolmap.Reconstruction(mapping.models[0]))
    assert rotation < 0.1
    assert distance < 0.002
    assert watched.stages == [("cameras", 10)]
    assert watched.done == [*range(2, 11), 10]
    assert [path.name for path in (tmp_path / "models").iterdir()] == ["0"]


def test_the_global_mapper_finds_the_same_poses_and_leaves_the_database_alone(
    ten: MatchedCapture, tmp_path: Path
) -> None:
    before = content(ten.database)
    rule = MappingRule(mapper="global")
    mapping = map_cameras(ten.database, tmp_path, rule)
    assert mapping.sizes == (10,)
    assert mapping.how == "global mapping (GLOMAP)"
    rotation, distance = ten.errors(pycolmap.Reconstruction(mapping.models[0]))
    assert rotation < 0.1
    assert distance < 0.002
    assert content(ten.database) == before
    assert [path.name for path in tmp_path.iterdir()] == ["0"]


def test_rendered_photos_give_the_poses_that_they_were_rendered_with(tmp_path: Path) -> None:
    database, images, cameras = captured.database(tmp_path, 6)
    mapping = map_cameras(database, tmp_path / "models", RULE)
    assert mapping.sizes == (6,)
    names = [image.name for image in images.images]
    truth = dict(zip(names, cameras.world_to_camera[:, :3].numpy(), strict=True))
    rotation, distance = pose_errors(pycolmap.Reconstruction(mapping.models[0]), truth)
    assert rotation < 0.5
    assert distance < 0.01


def test_photos_of_a_phone_give_the_poses_that_are_known_of_them(
    fox: tuple[Path, Path], tmp_path: Path
) -> None:
    database, known = fox
    mapping = map_cameras(database, tmp_path, RULE)
    assert mapping.sizes == (10,)
    images = pycolmap.Reconstruction(known).images.values()
    truth = {image.name: image.cam_from_world().matrix() for image in images}
    rotation, distance = pose_errors(pycolmap.Reconstruction(mapping.models[0]), truth)
    assert rotation < 1.0
    assert distance < 0.01


def test_the_same_database_gives_the_same_bits_and_replaces_old_models(
    ten: MatchedCapture, tmp_path: Path
) -> None:
    first = map_cameras(ten.database, tmp_path, RULE)
    old = poses(first.models[0])
    (tmp_path / "7").mkdir()
    new = poses(map_cameras(ten.database, tmp_path, RULE).models[0])
    assert old.keys() == new.keys()
    assert all((old[name] == new[name]).all() for name in old)
    assert [path.name for path in tmp_path.iterdir()] == ["0"]


def test_groups_without_common_matches_become_two_models_the_larger_first(tmp_path: Path) -> None:
    capture = matched_capture(
        tmp_path, 11, linked=lambda first, second: (first < 5) == (second < 5)
    )
    mapping = map_cameras(capture.database, tmp_path / "models", RULE)
    assert mapping.sizes == (7, 4)
    assert [path.name for path in mapping.models] == ["0", "1"]
    assert set(pycolmap.Reconstruction(mapping.models[0]).reg_image_ids()) == set(range(5, 12))


def test_images_without_matches_give_no_model_and_no_error(tmp_path: Path) -> None:
    capture = matched_capture(tmp_path, linked=lambda first, second: False)
    for mapper in ("incremental", "global"):
        rule = MappingRule(mapper=mapper)
        mapping = map_cameras(capture.database, tmp_path / mapper, rule)
        assert (mapping.models, mapping.sizes, mapping.merged) == ((), (), 0)
    assert "global" in mapping.how


def test_three_images_are_enough(tmp_path: Path) -> None:
    capture = matched_capture(tmp_path, 3)
    mapping = map_cameras(capture.database, tmp_path / "models", RULE)
    assert mapping.sizes == (3,)
    assert capture.errors(pycolmap.Reconstruction(mapping.models[0]))[0] < 0.1


def test_two_images_are_not_enough(tmp_path: Path) -> None:
    capture = matched_capture(tmp_path, 2)
    assert map_cameras(capture.database, tmp_path / "models", RULE).models == ()


def test_few_matches_are_tried_again_with_relaxed_thresholds(tmp_path: Path) -> None:
    capture = matched_capture(tmp_path, points=20)
    mapping = map_cameras(capture.database, tmp_path / "models", RULE)
    assert mapping.sizes == (10,)
    assert mapping.how == (
        "incremental mapping (COLMAP), relaxed thresholds (0 images by usual ones)"
    )
    assert capture.errors(pycolmap.Reconstruction(mapping.models[0]))[0] < 0.3


def test_a_principal_point_moves_only_where_that_is_asked_for(
    ten: MatchedCapture, tmp_path: Path
) -> None:
    fixed = map_cameras(ten.database, tmp_path / "fixed", RULE)
    rule = MappingRule(refine_principal_point=True)
    free = map_cameras(ten.database, tmp_path / "free", rule)
    assert list(pycolmap.Reconstruction(fixed.models[0]).camera(1).params[1:3]) == [512, 384]
    moved = pycolmap.Reconstruction(free.models[0]).camera(1).params[1:3]
    assert 0 < np.abs(moved - [512, 384]).max() < 8


@pytest.mark.parametrize("mapper", ["incremental", "global"])
def test_a_focal_length_that_is_given_stays(
    ten: MatchedCapture, tmp_path: Path, mapper: str
) -> None:
    rule = MappingRule(mapper=mapper, refine_focal=False)
    mapping = map_cameras(ten.database, tmp_path, rule)
    assert pycolmap.Reconstruction(mapping.models[0]).camera(1).params[0] == 1280


def test_ctrl_c_ends_mapping_and_the_next_run_gives_what_an_uninterrupted_one_does(
    ten: MatchedCapture, tmp_path: Path
) -> None:
    whole = map_cameras(ten.database, tmp_path / "whole", RULE)
    watched = WatchedStages(4, _thread.interrupt_main)
    with pytest.raises(KeyboardInterrupt), shown_by(watched.show):
        map_cameras(ten.database, tmp_path / "models", RULE)
    assert list((tmp_path / "models").iterdir()) == []
    again = map_cameras(ten.database, tmp_path / "models", RULE)
    old, new = poses(whole.models[0]), poses(again.models[0])
    assert all((old[name] == new[name]).all() for name in old)


def test_continuing_adds_images_that_have_been_matched_since(tmp_path: Path) -> None:
    (tmp_path / "few").mkdir()
    (tmp_path / "all").mkdir()
    few = matched_capture(
        tmp_path / "few", linked=lambda first, second: (first < 5) == (second < 5)
    )
    whole = matched_capture(tmp_path / "all")
    models = tmp_path / "models"
    before = map_cameras(few.database, models, RULE)
    assert before.sizes == (6, 4)
    after = continue_mapping(whole.database, models, before, RULE)
    assert after.sizes == (10,)
    assert after.merged == 1
    assert after.seconds > before.seconds
    assert after.how == (
        "incremental mapping (COLMAP), continued with relaxed thresholds (+4 images)"
    )
    assert sorted(path.name for path in models.iterdir()) == ["0", "1", "joined-0"]
    assert after.models == (models / "joined-0",)
    rotation, distance = whole.errors(pycolmap.Reconstruction(after.models[0]))
    assert rotation < 0.1
    assert distance < 0.002


def test_continuing_where_nothing_fits_keeps_the_models(tmp_path: Path) -> None:
    capture = matched_capture(tmp_path, linked=lambda first, second: (first < 5) == (second < 5))
    before = map_cameras(capture.database, tmp_path / "models", RULE)
    after = continue_mapping(capture.database, tmp_path / "models", before, RULE)
    assert [path.name for path in after.models] == ["joined-0", "joined-1"]
    assert (after.sizes, after.merged) == (before.sizes, 0)


def test_models_of_hardly_a_point_are_none() -> None:
    hollow, whole, larger = (pycolmap.Reconstruction() for _ in range(3))
    for model, points in ((hollow, LEAST_POINTS - 1), (whole, LEAST_POINTS), (larger, 50)):
        for _ in range(points):
            model.add_point3D(np.zeros(3), pycolmap.Track())
    assert solid([hollow, whole, larger]) == [larger, whole]


def test_a_mapping_survives_as_plain_data_in_a_folder_that_moved() -> None:
    mapping = Mapping((Path("a/0"), Path("a/1")), (7, 4), 1, 2.5, "somehow")
    document = json.loads(json.dumps(mapping.document()))
    moved = Mapping((Path("b/0"), Path("b/1")), (7, 4), 1, 2.5, "somehow")
    assert Mapping.of(document, Path("b")) == moved


def test_a_missing_database_is_named_and_not_created(tmp_path: Path) -> None:
    path = tmp_path / "database.db"
    with pytest.raises(DataError) as missing:
        map_cameras(path, tmp_path, RULE)
    assert str(missing.value) == (
        f"{path} is missing: it holds the features and matches of the images.\n"
        "Run the same command with a new out=DIR, so that they are computed anew."
    )
    assert not path.exists()


def test_a_file_that_is_no_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "database.db"
    path.write_bytes(b"not a database" * 100)
    with pytest.raises(DataError, match=r"COLMAP could not read the images with .*database\.db: "):
        map_cameras(path, tmp_path, RULE)


@pytest.mark.parametrize("mapper", ["incremental", "global"])
def test_what_colmap_throws_is_said_without_a_traceback(tmp_path: Path, mapper: str) -> None:
    capture = matched_capture(tmp_path, 3)
    with closing(sqlite3.connect(capture.database)) as opened:
        opened.execute("UPDATE cameras SET params = x'00'")
        opened.commit()
    with pytest.raises(DataError) as failure:
        map_cameras(capture.database, tmp_path / "models", MappingRule(mapper=mapper))
    assert "COLMAP could not compute camera poses" in failure.value.message
    assert "Run the same command with a new out=DIR" in failure.value.advice
