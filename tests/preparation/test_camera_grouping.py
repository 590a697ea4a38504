"""Which images share a camera."""

from dataclasses import replace
from pathlib import Path

import pytest

from gsfw.core.errors import ConfigError
from gsfw.datamanagers.images import Header
from gsfw.datamanagers.lens import COEFFICIENTS
from gsfw.preparation.camera_grouping import CameraRule, group_cameras
from gsfw.preparation.exif import Exif
from gsfw.preparation.image_set import ImageSet, SourceImage

PHONE = Exif(make="Apple", model="iPhone", lens="back", focal_mm=4.2, focal_35mm=26.0)


def image(name: str, size=(40, 30), exif=PHONE, group: str = "") -> SourceImage:
    return SourceImage(name, Path(name), Header(*size, has_alpha=False), exif, group)


def groups(*images: SourceImage, **rule) -> list[tuple[str, ...]]:
    found = group_cameras(ImageSet(images), CameraRule(**rule))
    assert [group.number for group in found] == list(range(1, len(found) + 1))
    return [group.images for group in found]


def test_no_images_have_no_cameras():
    assert groups() == []


def test_photos_of_one_phone_share_a_camera():
    assert groups(image("a"), image("b"), image("c")) == [("a", "b", "c")]


@pytest.mark.parametrize(
    "other",
    [
        replace(PHONE, make="Pear"),
        replace(PHONE, model="iPhone 2"),
        replace(PHONE, lens="wide"),
        replace(PHONE, focal_mm=9.0),
        replace(PHONE, focal_35mm=52.0),
        Exif(),
    ],
    ids=["make", "model", "lens", "focal length", "digital zoom", "silent"],
)
def test_another_camera_lens_or_zoom_is_another_camera(other):
    images = image("a"), image("b", exif=other), image("c")
    assert groups(*images) == [("a", "c"), ("b",)]


def test_when_a_photo_was_taken_does_not_matter():
    later = replace(PHONE, taken="2024:05:01 12:30:00")
    assert groups(image("a"), image("b", exif=later)) == [("a", "b")]


def test_upright_and_sideways_photos_are_two_cameras():
    images = image("a"), image("b", size=(30, 40)), image("c")
    assert groups(*images) == [("a", "c"), ("b",)]


def test_folders_do_not_matter_where_exif_says_what_the_camera_is():
    assert groups(image("x/a", group="x"), image("y/a", group="y")) == [("x/a", "y/a")]


def test_without_exif_each_folder_has_its_camera():
    images = [image(f"{folder}/a", exif=Exif(), group=folder) for folder in ("x", "y", "x")]
    assert groups(*images) == [("x/a", "x/a"), ("y/a",)]


def test_one_camera_per_folder():
    images = image("x/a", group="x"), image("y/a", group="y"), image("y/b", group="y")
    assert groups(*images, cameras="per-folder") == [("x/a",), ("y/a", "y/b")]


def test_one_camera_per_image():
    images = image("a"), image("b", size=(30, 40))
    assert groups(*images, cameras="per-image") == [("a",), ("b",)]


def test_one_camera_for_all_whatever_exif_says():
    images = image("x/a", group="x"), image("y/a", exif=Exif(), group="y")
    assert groups(*images, cameras="one") == [("x/a", "y/a")]


def test_one_camera_has_one_size():
    images = image("a"), image("b", size=(30, 40)), image("c"), image("d")
    with pytest.raises(ConfigError) as caught:
        groups(*images, cameras="one")
    assert str(caught.value) == (
        "cameras=one: the images have several sizes: 40x30 (a and 2 more), 30x40 (b).\n"
        "One camera has one size, and upright and sideways photos count as two. Use cameras=auto, "
        "or bring the images to one size."
    )


def test_one_camera_per_folder_has_one_size_in_each():
    images = [
        image("x/a", group="x"),
        image("y/a", size=(20, 10), group="y"),
        image("y/b", size=(10, 20), group="y"),
    ]
    assert len(groups(*images[:2], cameras="per-folder")) == 2
    with pytest.raises(ConfigError) as caught:
        groups(*images, cameras="per-folder")
    assert caught.value.message == (
        "cameras=per-folder: the images in y have several sizes: 20x10 (y/a), 10x20 (y/b)."
    )


def only_group(*images: SourceImage, **rule):
    (group,) = group_cameras(ImageSet(images), CameraRule(**rule))
    return group


def test_few_images_get_the_simpler_model():
    assert only_group(*(image(f"{n}") for n in range(19))).model == "SIMPLE_RADIAL"
    assert only_group(*(image(f"{n}") for n in range(20))).model == "OPENCV"


def test_a_model_is_taken_in_any_case():
    assert only_group(image("a"), model="opencv_fisheye").model == "OPENCV_FISHEYE"


def test_the_focal_length_is_first_the_users_then_exifs_then_a_usual_one():
    given = only_group(image("a"), focal=55.0)
    assert (given.focal, given.focal_origin) == (55.0, "given")
    told = only_group(image("a"))
    assert (told.focal, told.focal_origin) == (pytest.approx(26 / 43.27 * 50), "EXIF")
    usual = only_group(image("a", size=(30, 40), exif=Exif()))
    assert (usual.focal, usual.focal_origin) == (pytest.approx(48), "")
    assert (usual.width, usual.height) == (30, 40)


def test_where_images_disagree_the_median_focal_length_is_taken():
    equivalents = (26.0, 26.0, 500.0, None)
    images = [image(f"{mm}", exif=Exif(focal_35mm=mm)) for mm in equivalents]
    group = only_group(*images, cameras="one")
    assert group.focal == pytest.approx(26 / 43.27 * 50)


def test_other_models_are_refused():
    with pytest.raises(ConfigError) as caught:
        groups(image("a"), model="EQUIRECTANGULAR")
    assert str(caught.value) == (
        "camera_model=EQUIRECTANGULAR: there is no such camera model.\n"
        f"Expected auto, or one of {', '.join(COEFFICIENTS)}."
    )


@pytest.mark.parametrize("focal", [0.0, -5.0, float("nan"), float("inf")])
def test_other_focal_lengths_are_refused(focal):
    with pytest.raises(ConfigError) as caught:
        CameraRule(focal=focal).check()
    assert str(caught.value) == f"focal={focal:g}: expected a positive number of pixels."
