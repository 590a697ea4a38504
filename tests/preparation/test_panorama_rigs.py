"""Rigs of panoramas: their views keep one centre and their turns, whatever is computed."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from PIL import Image
from support.panorama_room import Walk, colors

from gsfw.datamanagers.images import Header
from gsfw.preparation.camera_grouping import CameraRule, group_cameras
from gsfw.preparation.database_part import part_of
from gsfw.preparation.diagnosis.match_graph import MatchGraph
from gsfw.preparation.diagnosis.model_figures import ModelFigures
from gsfw.preparation.exif import Exif
from gsfw.preparation.feature_database import FeatureDatabase
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet, SourceImage, ViewOfPanorama
from gsfw.preparation.mapping.incremental_mapping import USUAL, run_incremental
from gsfw.preparation.mapping.mapping import map_cameras
from gsfw.preparation.mapping.mapping_rule import MappingRule
from gsfw.preparation.mapping.merging import merge_models
from gsfw.preparation.mapping.observations import Observations, cut_loose
from gsfw.preparation.panorama_views import DIRECTIONS
from gsfw.preparation.preparation import Preparation, Prepared
from gsfw.preparation.preparation_rule import PreparationRule
from gsfw.preparation.sift import ImageFeatures
from gsfw.preparation.workspace import Workspace


def mixed(panoramas: int = 2) -> ImageSet:
    """A photo, and panoramas of two sizes as two views each."""
    photo = SourceImage("a.jpg", Path("a.jpg"), Header(160, 120, has_alpha=False), Exif())
    found = [photo]
    for number in range(panoramas):
        side = 100 + 20 * (number % 2)
        header = Header(side, side, has_alpha=False)
        found += [
            SourceImage(
                f"p{number}_{direction}.jpg",
                Path("p.jpg"),
                header,
                Exif(),
                view=ViewOfPanorama(f"p{number}.jpg", direction, side / 2),
            )
            for direction in range(2)
        ]
    return ImageSet(tuple(found))


def stored(folder: Path, images: ImageSet) -> Path:
    groups = group_cameras(images, CameraRule("one", "OPENCV", 70.0))
    nothing = ImageQuality(0.0, 0.0, 0.0, 0.0)
    keypoints, descriptors = np.zeros((0, 6), np.float32), np.zeros((0, 128), np.uint8)
    with FeatureDatabase(folder / "d.db", images, groups) as database:
        # The order in which features are found is that of processes.
        for image in reversed(images.images):
            found = ImageFeatures(image.name, nothing, (0.0, 1.0), keypoints, descriptors)
            database.write(found)
    return folder / "d.db"


def test_views_have_exact_cameras_whatever_the_user_says_of_others():
    photo, *views = group_cameras(mixed(), CameraRule("one", "OPENCV", 70.0))
    assert (photo.model, photo.focal, photo.rig) == ("OPENCV", 70.0, None)
    assert [(one.model, one.focal, one.view, one.rig) for one in views] == [
        ("SIMPLE_PINHOLE", 50.0, 0, 2),
        ("SIMPLE_PINHOLE", 50.0, 1, 2),
        ("SIMPLE_PINHOLE", 60.0, 0, 4),
        ("SIMPLE_PINHOLE", 60.0, 1, 4),
    ]


def test_the_database_has_a_rig_for_each_size_and_a_frame_for_each_panorama(tmp_path):
    with pycolmap.Database.open(stored(tmp_path, mixed(4))) as database:
        assert database.num_rigs() == 3
        frames = {frame.frame_id: frame for frame in database.read_all_frames()}
        assert [len(frames[number].data_ids) for number in sorted(frames)] == [1, 2, 2, 2, 2]
        rig = database.read_rig(frames[2].rig_id)
        (second,) = rig.non_ref_sensors
        moved = rig.sensor_from_rig(second)
        assert np.allclose(moved.rotation.matrix(), DIRECTIONS[1].from_panorama)
        assert np.allclose(moved.translation, 0)


def test_views_that_are_left_out_change_neither_frames_nor_turns(tmp_path):
    every = mixed(3)
    # Panoramas of one size, of which the first lacks its view ahead.
    images = ImageSet(tuple(one for one in every.images if one.name not in ("a.jpg", "p0_0.jpg")))
    with pycolmap.Database.open(stored(tmp_path, images)) as database:
        frames = {
            frame.frame_id: sorted(data.id for data in frame.data_ids)
            for frame in database.read_all_frames()
        }
        assert frames == {1: [1], 2: [2, 3], 4: [4, 5]}
        assert [database.read_frame(number).rig_id for number in frames] == [1, 2, 1]
        (second,) = (rig := database.read_rig(1)).non_ref_sensors
        turn = rig.sensor_from_rig(second).rotation.matrix()
        assert np.allclose(turn @ DIRECTIONS[1].from_panorama, DIRECTIONS[0].from_panorama)


def test_a_part_of_a_database_has_the_frames_of_its_images(tmp_path):
    content = part_of(stored(tmp_path, mixed(2)), [3, 4])
    (tmp_path / "part.db").write_bytes(content)
    with pycolmap.Database.open(tmp_path / "part.db") as part:
        frames = part.read_all_frames()
        assert sorted(data.id for frame in frames for data in frame.data_ids) == [3, 4]


def test_a_panorama_is_one_component_without_a_match(tmp_path):
    images = mixed(2)
    graph = MatchGraph.read(stored(tmp_path, images), images)
    assert [one.images for one in graph.components()] == [
        ("p0_0.jpg", "p0_1.jpg"),
        ("p1_0.jpg", "p1_1.jpg"),
    ]


def test_a_shot_is_whole_only_with_all_of_its_views():
    images = mixed(2)
    assert images.whole_shots({"a.jpg", "p0_0.jpg", "p1_0.jpg", "p1_1.jpg"}) == {
        "a.jpg",
        "p1_0.jpg",
        "p1_1.jpg",
    }


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory) -> Path:
    """COLMAP's synthetic points, seen by five rigs of two cameras with one centre."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 2, 5
    options.num_points3D = 120
    options.sensor_from_rig_translation_stddev = 0.0
    options.sensor_from_rig_rotation_stddev = 20.0
    pycolmap.set_random_seed(0)
    path = tmp_path_factory.mktemp("synthetic") / "database.db"
    with pycolmap.Database.open(path) as database:
        pycolmap.synthesize_dataset(options, database)
    return path


def named(frames: range) -> list[str]:
    """Names of the synthetic images."""
    return [f"camera00000{one}_frame00000{frame}.png" for frame in frames for one in (1, 2)]


def models(database: Path, folder: Path, known: tuple[int, ...] = (1, 2)) -> list:
    folder.mkdir()
    return run_incremental(database, folder, MappingRule(known_cameras=known), USUAL)


def test_frames_are_placed_whole_and_known_cameras_stay(synthetic, tmp_path):
    (model,) = models(synthetic, tmp_path / "m")
    assert model.num_reg_frames() == 5
    assert model.num_reg_images() == 10
    with pycolmap.Database.open(synthetic) as database:
        for number in (1, 2):
            given = database.read_camera(number).params
            assert np.array_equal(model.camera(number).params, given)
    seen = Observations.of(model)
    assert len(seen.by_frame(model).image_ids) == 5
    assert seen.by_frame(model).counts.sum() == seen.counts.sum()
    figures = ModelFigures.of(model)
    assert figures.baselines.to_depth > 0.01
    assert cut_loose(model) == 0


@pytest.mark.slow
def test_global_mapping_places_frames_whole_too(synthetic, tmp_path):
    rule = MappingRule(mapper="global", known_cameras=(1, 2))
    mapping = map_cameras(synthetic, tmp_path / "m", rule)
    model = pycolmap.Reconstruction(mapping.models[0])
    assert model.num_reg_frames() == 5
    assert model.num_reg_images() == 10
    with pycolmap.Database.open(synthetic) as database:
        for number in (1, 2):
            # Views have no distortion, which is computed here.
            given = database.read_camera(number).params[:3]
            assert np.array_equal(model.camera(number).params[:3], given)
    for frame in model.frames.values():
        centers = [model.image(data.id).projection_center() for data in frame.data_ids]
        assert np.allclose(centers[0], centers[1], atol=1e-9)


def test_models_of_frames_are_joined(synthetic, tmp_path):
    folder, rule = tmp_path / "m", MappingRule(known_cameras=(1, 2))
    folder.mkdir()
    parts = [
        run_incremental(synthetic, folder, rule, USUAL, among=named(frames))[0]
        for frames in (range(4), range(1, 5))
    ]
    assert [part.num_reg_images() for part in parts] == [8, 8]
    (joined,), count = merge_models(parts, synthetic, folder, rule)
    assert count == 1
    assert joined.num_reg_frames() == 5
    assert joined.num_reg_images() == 10


def aligned(centers: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centres after the similarity that brings them nearest to the true ones; both around 0."""
    centers, truth = centers - centers.mean(0), truth - truth.mean(0)
    left, sizes, right = np.linalg.svd(truth.T @ centers)
    return sizes.sum() / (centers**2).sum() * centers @ (left @ right).T, truth


def prepared_model(photos: Path, out: Path) -> tuple[pycolmap.Reconstruction, Prepared]:
    place, rule = Workspace(out), PreparationRule(thorough=False)
    with place.claimed((photos,)):
        prepared = Preparation((photos,), place, rule, lambda line: None).run()
    return pycolmap.Reconstruction(place.sparse / "0"), prepared


def assert_one_centre_each(model: pycolmap.Reconstruction, count: int) -> None:
    """Check that the views of panoramas have all been placed, with one centre for each."""
    views = [image for image in model.images.values() if image.name.startswith("R")]
    assert len(views) == 6 * count
    for image in views:
        mates = [one for one in views if one.name[:6] == image.name[:6]]
        spread = np.ptp([one.projection_center() for one in mates], axis=0)
        assert np.abs(spread).max() < 1e-9


@pytest.mark.slow
def test_panoramas_have_their_true_places_and_photos_among_them_a_lens_of_their_own(tmp_path):
    walk, focal = Walk.of(5), 400.0
    walk.write(tmp_path / "photos", 640)
    places = walk.centers + np.array([0.15, 0.1, -0.1])
    y, x = np.mgrid[:360, :480] + 0.5
    rays = np.stack([(x - 240) / focal, (y - 180) / focal, np.ones_like(x)], axis=-1)
    for number, (center, turn) in enumerate(zip(places, walk.turns, strict=True)):
        pixels = colors(center, rays @ turn).round().astype(np.uint8)
        Image.fromarray(pixels).save(tmp_path / "photos" / f"P{number:04d}.jpg", quality=95)
    model, prepared = prepared_model(tmp_path / "photos", tmp_path / "out")
    assert len(prepared.diagnosis.registered) == 35
    assert "30 of 35 images are views of 5 panoramas" in " ".join(prepared.diagnosis.figures)
    assert_one_centre_each(model, 5)
    by_name = {image.name: image for image in model.images.values()}
    names = [f"P{number:04d}.jpg" for number in range(5)]
    names += [f"R{number:04d}_000.jpg" for number in range(5)]
    centers = np.array([by_name[name].projection_center() for name in names])
    moved, truth = aligned(centers, np.concatenate([places, walk.centers]))
    extent = np.linalg.norm(walk.centers.max(0) - walk.centers.min(0))
    assert np.linalg.norm(moved - truth, axis=1).max() < 0.01 * extent
    assert model.camera(by_name["P0000.jpg"].camera_id).mean_focal_length() == pytest.approx(
        focal, rel=0.01
    )
    of_view = model.camera(by_name["R0000_000.jpg"].camera_id)
    assert of_view.mean_focal_length() == of_view.width / 2
