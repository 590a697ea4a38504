import dataclasses
import math
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pycolmap
import pytest
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from support import captured
from support.watched_stages import WatchedStages

from gsfw.core.errors import ConfigError, DataError, UnavailableError
from gsfw.core.progress import shown_by
from gsfw.datamanagers.images import Header, read_header
from gsfw.preparation import feature_search, features
from gsfw.preparation.camera_grouping import CameraGroup
from gsfw.preparation.exif import Exif
from gsfw.preparation.features import FeatureReport, FeatureSettings, extract_features
from gsfw.preparation.image_quality import ImageQuality
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.sift import ImageFeatures, ImageTask, find_features

SETTINGS = FeatureSettings(max_size=320, count=1000, jobs=1)
ALWAYS = 10**6
"""More features than there are, so that the finest are looked for in any case."""


@pytest.fixture(autouse=True)
def quiet():
    pycolmap.logging.minloglevel = 2


def texture(width: int, height: int, seed: int = 3) -> np.ndarray:
    """Blobs of several sizes, [height, width, 3] in 8 bits."""
    noise = np.random.default_rng(seed).normal(size=(height, width))
    mixed = sum(size * gaussian_filter(noise, size) for size in (2, 4, 8))
    grey = 128 + 60 * mixed / mixed.std()
    return np.repeat(grey.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)


def save(path: Path, pixels: np.ndarray, **options) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)
    return path


def task(path: Path, size: int = 320, count: int = 1000, enough: int = ALWAYS) -> ImageTask:
    return ImageTask(path.name, path, read_header(path), size, count, 320, enough)


def imagined(count: int, width: int = 4000, height: int = 3000) -> ImageSet:
    """A set that nothing is read of."""
    header = Header(width, height, has_alpha=False)
    return ImageSet(
        tuple(
            SourceImage(f"{number:04d}.jpg", Path("nowhere"), header, Exif())
            for number in range(count)
        )
    )


def three(folder: Path) -> ImageSet:
    """Three small images with many features."""
    paths = [save(folder / f"{name}.png", texture(160, 120, ord(name))) for name in "abc"]
    return captured.image_set(paths)


def content(database: Path) -> list[np.ndarray]:
    """All that a database holds of cameras, images and features."""
    with pycolmap.Database.open(database) as opened:
        found = [np.array([str(one) for one in opened.read_all_cameras()])]
        found += [np.array([str(one) for one in opened.read_all_rigs()])]
        found += [np.array([str(one) for one in opened.read_all_frames()])]
        for image in opened.read_all_images():
            found += [np.array([str(image)]), opened.read_keypoints(image.image_id)]
            found += [opened.read_descriptors(image.image_id).data]
    return found


def assert_same(first: Path, second: Path) -> None:
    one, other = content(first), content(second)
    assert len(one) == len(other)
    assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


GB = 1_000_000_000


@pytest.mark.parametrize(
    ("free", "jobs"), [(math.inf, 8), (64 * GB, 8), (4.5 * GB, 4), (0.2 * GB, 1)]
)
def test_no_more_processes_look_for_features_than_memory_has_room_for(monkeypatch, free, jobs):
    monkeypatch.setattr("gsfw.core.machine_memory.free_memory", lambda: free)
    settings, how = FeatureSettings.for_machine(imagined(50), 8, None, None)
    assert settings.jobs == jobs
    assert (f"8 cores ({jobs} for features, as each needs 1.0 GB)" in how) == (jobs < 8)


def test_keypoints_of_a_shrunk_image_lie_where_those_of_the_whole_one_do(tmp_path):
    # Twice as large an image of the same thing, with other sizes along x and y after shrinking.
    small = texture(240, 161)
    path = save(tmp_path / "large.png", np.kron(small, np.ones((2, 2, 1), np.uint8))[:, :479])
    whole = find_features(task(path, size=480)).keypoints
    shrunk = find_features(task(path, size=240)).keypoints
    distances, nearest = cKDTree(whole[:, :2]).query(shrunk[:, :2])
    close = distances < 1.0
    assert close.mean() > 0.8
    offset = shrunk[close, :2] - whole[nearest[close], :2]
    assert np.abs(np.median(offset, axis=0)).max() < 0.1
    scales = [np.sqrt(np.abs(np.linalg.det(k[:, 2:].reshape(-1, 2, 2)))) for k in (shrunk, whole)]
    ratio = np.median(scales[0][close] / scales[1][nearest[close]])
    assert ratio == pytest.approx(1.0, abs=0.05)


def test_no_more_features_are_kept_than_asked_for_and_those_of_the_largest_scale(tmp_path):
    path = save(tmp_path / "many.png", texture(160, 120))
    every, some = (find_features(task(path, count=count)).keypoints for count in (1000, 40))
    assert len(some) == 40 < len(every)
    scales, kept = (np.linalg.det(found[:, 2:].reshape(-1, 2, 2)) for found in (every, some))
    assert kept.min() >= 0.99 * np.sort(scales)[-40]


def test_a_blob_is_found_at_its_centre(tmp_path):
    y, x = np.mgrid[:120, :160] + 0.5
    blob = 200 * np.exp(-((x - 61.3) ** 2 + (y - 47.8) ** 2) / (2 * 5.0**2))
    pixels = np.repeat((30 + blob).astype(np.uint8)[..., None], 3, axis=2)
    found = find_features(task(save(tmp_path / "blob.png", pixels))).keypoints
    assert np.abs(found[:, :2] - [61.3, 47.8]).max(axis=1).min() < 0.2


def test_an_image_turned_by_exif_has_the_features_of_the_upright_one(tmp_path):
    upright = texture(160, 120)
    exif = Image.Exif()
    exif[0x0112] = 6  # The camera was turned: the file's rows are columns.
    turned = save(tmp_path / "turned.png", np.rot90(upright).copy(), exif=exif)
    plain = save(tmp_path / "plain.png", upright)
    assert read_header(turned).orientation == 6
    one, other = find_features(task(plain)), find_features(task(turned))
    np.testing.assert_array_equal(one.keypoints, other.keypoints)
    np.testing.assert_array_equal(one.descriptors, other.descriptors)
    assert one.quality == other.quality


def test_nothing_is_found_where_an_image_is_transparent(tmp_path):
    pixels = np.dstack([texture(160, 120), np.full((120, 160), 255, np.uint8)])
    pixels[:, :80, 3] = 0
    path = save(tmp_path / "cut.png", pixels)
    found = find_features(task(path))
    assert len(found.keypoints) > 20
    assert found.keypoints[:, 0].min() >= 80
    whole = find_features(task(save(tmp_path / "whole.png", texture(160, 120)))).quality
    assert found.quality.contrast == pytest.approx(whole.contrast, rel=0.2)


def test_the_database_has_one_camera_for_a_group_and_frames_that_colmap_understands(tmp_path):
    images = three(tmp_path / "photos")
    a, b, c = (image.name for image in images.images)
    groups = (
        CameraGroup(1, "SIMPLE_RADIAL", 160, 120, 150.0, "EXIF", (a, c)),
        CameraGroup(2, "OPENCV", 160, 120, 190.0, "", (b,)),
    )
    reports = extract_features(tmp_path / "d.db", images, groups, SETTINGS)
    assert list(reports) == [a, b, c]
    with pycolmap.Database.open(tmp_path / "d.db") as opened:
        first, second = opened.read_all_cameras()
        assert (first.model.name, second.model.name) == ("SIMPLE_RADIAL", "OPENCV")
        assert (first.focal_length, first.principal_point_x) == (150.0, 80.0)
        assert (first.has_prior_focal_length, second.has_prior_focal_length) == (True, False)
        rows = opened.read_all_images()
        assert [(one.image_id, one.name, one.camera_id) for one in rows] == [
            (1, a, 1),
            (2, b, 2),
            (3, c, 1),
        ]
        assert [rig.ref_sensor_id.id for rig in opened.read_all_rigs()] == [1, 2]
        assert [frame.rig_id for frame in opened.read_all_frames()] == [1, 2, 1]
        for row, report in zip(rows, reports.values(), strict=True):
            assert opened.num_keypoints_for_image(row.image_id) == report.count > 50


def test_an_image_that_does_not_decode_is_reported_and_not_in_the_database(tmp_path):
    images = three(tmp_path / "photos")
    broken = images.images[1].path
    broken.write_bytes(broken.read_bytes()[:900])
    database = tmp_path / "d.db"
    reports = extract_features(database, images, captured.one_group(images), SETTINGS)
    assert [bool(report.failure) for report in reports.values()] == [False, True, False]
    assert reports["b.png"].failure.startswith(f"{broken}: the image does not decode: ")
    assert (reports["b.png"].count, reports["b.png"].blur_direction) == (0, None)
    with pycolmap.Database.open(database) as opened:
        assert [image.image_id for image in opened.read_all_images()] == [1, 3]
    again = extract_features(database, images, captured.one_group(images), SETTINGS)
    assert again == reports


def test_an_image_that_was_replaced_meanwhile_is_reported(tmp_path):
    images = three(tmp_path / "photos")
    save(images.images[0].path, texture(100, 100))
    groups = captured.one_group(images)
    reports = extract_features(tmp_path / "d.db", images, groups, SETTINGS)
    assert reports["a.png"].failure == (
        f"{images.images[0].path}: the image was replaced while it was prepared."
    )


def test_a_uniform_image_has_no_features_and_no_direction_of_blur(tmp_path):
    path = save(tmp_path / "grey.png", np.full((120, 160, 3), 90, np.uint8))
    images = captured.image_set([path])
    groups = captured.one_group(images)
    report = extract_features(tmp_path / "d.db", images, groups, SETTINGS)["grey.png"]
    assert (report.count, report.blur_direction, report.blur_ratio) == (0, None, 1.0)
    assert report.failure == ""


@pytest.mark.slow
def test_the_finest_features_are_looked_for_only_where_there_are_few_others(tmp_path):
    (photo,) = captured.photos(captured.arc(1))
    path = save(tmp_path / "a.png", photo)
    every, others = find_features(task(path)), find_features(task(path, enough=20))
    number = len(others.keypoints)
    assert (every.enlarged, others.enlarged) == (True, False)
    assert 20 <= number < len(every.keypoints)
    few = find_features(task(path, enough=number + 1))
    assert few.enlarged
    np.testing.assert_array_equal(few.keypoints, every.keypoints)


def test_thorough_settings_look_for_the_finest_features_of_all_images():
    usual, _ = FeatureSettings.for_machine(imagined(50), 2, None, None)
    closer, how = FeatureSettings.for_machine(imagined(50), 2, None, None, thorough=True)
    assert (usual.enough, closer.enough > closer.count) == (features.ENOUGH, True)
    assert "on up to 1600 pixels, the finest too, with 2 cores" in how
    finding, others = (one.seconds(imagined(50), 2)[0] for one in (closer, usual))
    assert finding > 1.9 * others
    assert FeatureSettings.for_machine(imagined(3), 1, None, 200)[0].enough == 200


@pytest.mark.parametrize("torn", [False, True])
def test_an_interrupted_extraction_goes_on_and_ends_with_the_same(tmp_path, torn, monkeypatch):
    images = three(tmp_path / "photos")
    groups = captured.one_group(images)
    whole, part = tmp_path / "whole" / "d.db", tmp_path / "part" / "d.db"
    expected = extract_features(whole, images, groups, SETTINGS)
    with pytest.raises(KeyboardInterrupt), shown_by(WatchedStages(2).show):
        extract_features(part, images, groups, SETTINGS)
    log = part.with_name("features.jsonl")
    assert len(log.read_text().splitlines()) == 2
    if torn:  # The process was killed while it wrote the second line.
        log.write_text(log.read_text()[:-40])
    looked_at = []

    def watched(one: ImageTask) -> ImageFeatures:
        looked_at.append(one.name)
        return find_features(one)

    monkeypatch.setattr(feature_search, "find_features", watched)
    assert extract_features(part, images, groups, SETTINGS) == expected
    assert looked_at == (["b.png", "c.png"] if torn else ["c.png"])
    assert_same(whole, part)


@pytest.mark.slow
def test_two_processes_find_the_same_bits_as_one(tmp_path, monkeypatch):
    images = three(tmp_path / "photos")
    groups = captured.one_group(images)
    alone, together = tmp_path / "alone" / "d.db", tmp_path / "together" / "d.db"
    monkeypatch.setattr(feature_search, "WORKER_SECONDS", 0.0)
    first = extract_features(alone, images, groups, SETTINGS)
    two = dataclasses.replace(SETTINGS, jobs=2)
    assert extract_features(together, images, groups, two) == first
    assert_same(alone, together)


def test_a_process_that_is_ended_from_outside_is_named(tmp_path, monkeypatch):
    images = three(tmp_path / "photos")

    monkeypatch.setattr(feature_search, "WORKER_SECONDS", 0.0)
    monkeypatch.setattr(feature_search, "start_worker", sys.exit)
    two = dataclasses.replace(SETTINGS, jobs=2)
    with pytest.raises(UnavailableError) as caught:
        extract_features(tmp_path / "d.db", images, captured.one_group(images), two)
    assert str(caught.value) == (
        "one of 2 processes that look for features was ended from outside, most likely because "
        "memory ran out.\nRun the same command again with fewer processes (jobs=1): it continues "
        "with the images that are not done. If that does not help, look on smaller images "
        "(feature_size=1000)."
    )


def test_a_file_that_is_no_database_is_refused(tmp_path):
    images = three(tmp_path / "photos")
    (tmp_path / "d.db").write_text("something else")
    with pytest.raises(DataError, match="COLMAP could not open the features with"):
        extract_features(tmp_path / "d.db", images, captured.one_group(images), SETTINGS)


def test_a_report_survives_json():
    report = FeatureReport(12, ImageQuality(0.1, 0.2, 0.3, 0.4), 15.0, 0.5)
    assert FeatureReport.of(dataclasses.asdict(report)) == report


def test_settings_are_chosen_for_the_machine_and_said():
    settings, how = FeatureSettings.for_machine(imagined(50), 2, None, None)
    assert settings == FeatureSettings(1600, 4000, 2)
    assert how == (
        "features: at most 4000 in each of 50 images, on up to 1600 pixels, with 2 cores: "
        "about 37 s, then about 58 s for matching and 15 s for the cameras."
    )


def test_the_sentence_suits_a_single_image():
    _, how = FeatureSettings.for_machine(imagined(1), 1, None, None)
    assert how.startswith("features: at most 4000 in the only image, on up to 1600 pixels, with")


def test_a_large_set_on_a_small_machine_gets_fewer_features():
    settings, how = FeatureSettings.for_machine(imagined(2000), 2, None, None)
    assert settings == FeatureSettings(1000, 2000, 2)
    assert "about 16 min, then about 10 min for matching and 10 min for the cameras." in how
    chosen, _ = FeatureSettings.for_machine(imagined(2000), 2, 1400, 3000)
    assert chosen == FeatureSettings(1400, 3000, 2)
    assert FeatureSettings.for_machine(imagined(3), 64, None, None)[0].jobs == 3


@pytest.mark.parametrize(
    ("size", "count", "message"),
    [
        (10, None, "feature_size=10: expected 64 to 100000."),
        (None, 5, "features=5: expected 50 to 32768."),
        (None, 10**12, "features=1000000000000: expected 50 to 32768."),
    ],
)
def test_too_few_features_or_more_than_can_be_matched_are_refused(size, count, message):
    with pytest.raises(ConfigError) as caught:
        FeatureSettings.for_machine(imagined(3), 1, size, count)
    assert str(caught.value) == f"{message}\nLeave it out to have it chosen."


@pytest.mark.slow
def test_features_do_not_depend_on_the_image_before():
    def found(name: str, pixels: np.ndarray, folder: Path) -> ImageFeatures:
        path = save(folder / name, pixels)
        return find_features(ImageTask(name, path, read_header(path), 320, 1000, 320, ALWAYS))

    (photo,) = captured.photos(captured.arc(1))
    glaring = (photo.astype(int) * 6 + 140).clip(0, 255).astype(np.uint8)
    with TemporaryDirectory() as folder:
        before = found("a.png", photo, Path(folder))
        assert len(found("b.png", glaring, Path(folder)).keypoints) < 50
        after = found("a.png", photo, Path(folder))
    np.testing.assert_array_equal(before.keypoints, after.keypoints)
    np.testing.assert_array_equal(before.descriptors, after.descriptors)
