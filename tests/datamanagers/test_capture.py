"""The data manager over the frames of a file."""

import threading
from dataclasses import replace

import pytest
import torch
from PIL import Image
from support.color_profiles import DISPLAY_P3, profile
from support.small_captures import (
    HEIGHT,
    WIDTH,
    builder_of,
    request,
    ring,
    write_colmap,
    write_image,
    write_images,
    write_transforms,
)

from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError, DataError
from gsfw.datamanagers.colmap.config import ColmapConfig
from gsfw.datamanagers.transforms import TransformsConfig

CPU = torch.device("cpu")


@pytest.fixture
def folder(tmp_path):
    """A COLMAP data set of 6 views."""
    write_colmap(tmp_path / "sparse/0", ring(6))
    write_images(tmp_path / "images", ring(6))
    return tmp_path


build = builder_of(ColmapConfig)


def test_batches_hold_float_images_with_their_cameras(folder):
    data = build(folder, eval_every_nth=3)
    (batch,) = data.load(Split.TRAIN, [3, 1], CPU)
    assert batch.views == (3, 1)
    assert batch.images.shape == (2, HEIGHT, WIDTH, 3)
    assert batch.images.dtype == torch.float32
    assert 0 <= float(batch.images.min()) < float(batch.images.max()) <= 1
    assert batch.cameras.camera_index.tolist() == [0, 0]
    assert batch.cameras.camera_index.dtype == torch.int64
    assert (batch.alpha, batch.mask, batch.time) == (None, None, None)


def test_views_are_sorted_by_name_whatever_the_order_in_the_file(tmp_path):
    capture = replace(ring(3), names=["c.png", "a.png", "b.png"])
    write_colmap(tmp_path, capture)
    write_images(tmp_path / "images", capture)
    assert build(tmp_path).views(Split.TRAIN).names == ("a.png", "b.png", "c.png")


def test_the_scene_frame_comes_from_the_training_cameras_alone(folder):
    scene = build(folder, eval_every_nth=2).scene
    centers = scene.camera_centers
    assert centers.shape == (3, 3)
    torch.testing.assert_close(centers.mean(0), torch.zeros(3), atol=1e-6, rtol=0)
    assert 1.1 * float(centers.norm(dim=1).max()) == pytest.approx(scene.extent) == 1.0


def test_images_are_the_same_however_little_may_be_kept(folder):
    wanted = [batch.images for batch in build(folder).load(Split.TRAIN, range(6), CPU)]
    for megabytes in (0, 2048):
        data = build(folder, cache_megabytes=megabytes)
        for _ in range(2):
            data.prefetch(Split.TRAIN, range(6))
            found = [batch.images for batch in data.load(Split.TRAIN, range(6), CPU)]
            assert all(torch.equal(*pair) for pair in zip(wanted, found, strict=True))
        data.close()


def test_threads_end_with_the_data(folder):
    before = set(threading.enumerate())
    data = build(folder)
    data.prefetch(Split.TRAIN, range(6))
    assert set(threading.enumerate()) - before
    data.close()
    assert set(threading.enumerate()) <= before


def test_an_image_that_is_cut_off_is_named_when_it_is_loaded(folder):
    path = folder / "images/view_001.png"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    data = build(folder)
    with pytest.raises(DataError, match=r"images/view_001\.png: the image does not decode: "):
        data.load(Split.TRAIN, [1], CPU)
    data.close()


def test_an_image_that_is_none_is_named_when_the_data_set_is_opened(folder):
    (folder / "images/view_004.png").write_bytes(b"")
    with pytest.raises(DataError, match=r"images/view_004\.png: the file is empty \(0 bytes\)\."):
        build(folder)


def test_an_image_with_alpha_beside_one_without_counts_as_covered(folder):
    write_image(folder / "images/view_000.png", mode="RGBA")
    data = build(folder)
    assert data.scene.has_alpha
    (batch,) = data.load(Split.TRAIN, [0, 1], CPU)
    assert float(batch.alpha[0].min()) < 0.1
    assert bool((batch.alpha[1] == 1).all())
    (opaque,) = data.load(Split.TRAIN, [1], CPU)
    assert opaque.alpha is None


def test_names_may_be_held_out(folder):
    data = build(folder, eval_names=("view_002.png", "view_004.png"), eval_every_nth=8)
    assert data.views(Split.EVAL).names == ("view_002.png", "view_004.png")
    assert data.notes()[-1] == "held-out views: by name"


def test_holding_everything_out_is_refused(folder):
    with pytest.raises(DataError) as error:
        build(folder, eval_every_nth=1)
    assert str(error.value) == (
        f"{folder}: no view is left to train on; all 6 are held out.\n"
        "Hold out fewer images (holdout_every=0 holds out none)."
    )


def test_an_image_that_is_listed_twice_is_refused(tmp_path):
    capture = replace(ring(3), names=["a.png", "b.png", "a.png"])
    write_images(tmp_path, capture)
    path = write_transforms(tmp_path / "transforms.json", capture)
    with pytest.raises(DataError) as error:
        TransformsConfig().build(request(tmp_path))
    assert str(error.value) == (f"{path}: a.png is listed twice.\nRemove one of its two entries.")


def test_a_single_image_can_be_trained_on(tmp_path):
    write_colmap(tmp_path, ring(1))
    write_images(tmp_path / "images", ring(1))
    scene = build(tmp_path).scene
    assert scene.extent == 1.0
    assert float(scene.points.norm(dim=1).median()) == pytest.approx(1.0)


def test_photos_with_a_profile_keep_their_numbers_on_request(folder):
    path = folder / "images" / ring(6).names[1]
    Image.new("RGB", (WIDTH, HEIGHT), (200, 50, 40)).save(path, icc_profile=profile(DISPLAY_P3))

    def color(**settings):
        data = ColmapConfig(**settings).build(request(folder))
        view = data.views(Split.TRAIN).names.index(path.name)
        (batch,) = data.load(Split.TRAIN, [view], CPU)
        small = data.load_small(Split.TRAIN, view, WIDTH // 2, HEIGHT // 2)
        assert torch.allclose(batch.images[0, 0, 0], small.images[0, 0, 0], atol=0.01)
        return (255 * batch.images[0, 0, 0]).round().tolist()

    assert color(colors="stored") == [200, 50, 40]
    assert color()[0] > 210
    with pytest.raises(ConfigError, match=r"datamanager.colors=raw: expected srgb or stored."):
        color(colors="raw")


def test_images_whose_colours_are_not_converted_are_named(folder):
    path = folder / "images" / ring(6).names[1]
    Image.new("RGB", (WIDTH, HEIGHT)).save(path, icc_profile=b"none")
    (note,) = (note for note in build(folder).notes() if "sRGB" in note)
    assert note == (
        f"colours of {path.name} are not converted to sRGB and may look wrong (a colour profile "
        "that cannot be applied): save them as sRGB in a photo program"
    )
    stored = ColmapConfig(colors="stored").build(request(folder)).notes()
    assert not any("sRGB" in note for note in stored)
