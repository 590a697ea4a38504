"""Masks beside the images of any format, and what they mean."""

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from support.small_captures import (
    CENTER,
    FOCAL,
    HEIGHT,
    WIDTH,
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
VIEWS = 3
STRONG = -0.3
"""A radial distortion that leaves corners of undistorted images blank."""
LEFT = np.zeros((HEIGHT, WIDTH), bool)
LEFT[:, : WIDTH // 2] = True


@pytest.fixture
def folder(tmp_path):
    """A COLMAP data set of three views."""
    write_colmap(tmp_path / "sparse/0", ring(VIEWS))
    write_images(tmp_path / "images", ring(VIEWS))
    return tmp_path


def write_mask(path: Path, inside: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(255 * inside.astype(np.uint8)).save(path)


def write_masks(folder: Path, inside: np.ndarray = LEFT, suffix: str = ".png") -> None:
    for name in ring(VIEWS).names:
        write_mask(folder / Path(name).with_suffix(suffix), inside)


def open_colmap(folder, downscale=1.0, **settings):
    return ColmapConfig(**settings).build(request(folder, downscale=downscale))


def load(data):
    """The batch of all training views."""
    (batch,) = data.load(Split.TRAIN, range(VIEWS), CPU)
    return batch


def mask_notes(data):
    return list(data.notes()[1:-1])


@pytest.mark.parametrize("suffix", [".png", ".png.png"])
def test_masks_beside_the_images_are_found(folder, suffix):
    write_masks(folder / "masks", suffix=suffix)
    data = open_colmap(folder)
    batch = load(data)
    assert batch.alpha is None
    assert all(np.array_equal(mask[..., 0], LEFT) for mask in batch.valid)
    assert mask_notes(data) == [
        "3 of 3 images have masks, which keep 50 % of their pixels: pixels outside of the "
        "masks have no loss (datamanager.mask_mode=ignore)"
    ]


@pytest.mark.parametrize(
    "form",
    ["{}.jpg", "{}.JPG", "{}.png.jpg", "{}_mask.png", "mask_{}.bmp", "{}.mask.png", "{}.gif"],
)
def test_masks_of_any_image_format_and_usual_naming_are_found(folder, form):
    for name in ring(VIEWS).names:
        write_mask(folder / "masks" / form.format(Path(name).stem), LEFT)
    batch = load(open_colmap(folder))
    inside = batch.valid[..., 0].float()
    assert float((inside != torch.from_numpy(LEFT).float()).float().mean()) < 0.02


def test_a_mask_of_another_image_is_not_taken(folder):
    write_mask(folder / "masks/view_0001.png", LEFT)
    write_mask(folder / "masks/preview_001.png", LEFT)
    assert load(open_colmap(folder)).valid is None


def test_transforms_whose_names_begin_with_the_images_folder_find_theirs(tmp_path):
    capture = ring(VIEWS)
    write_images(tmp_path / "images", capture)
    write_transforms(
        tmp_path / "transforms.json",
        capture,
        [{"file_path": f"images/{name}"} for name in capture.names],
    )
    write_masks(tmp_path / "masks")
    batch = load(TransformsConfig().build(request(tmp_path)))
    assert all(np.array_equal(mask[..., 0], LEFT) for mask in batch.valid)


def test_what_a_file_names_comes_before_a_guess_but_not_before_a_named_folder(tmp_path):
    capture = ring(VIEWS)
    write_images(tmp_path, capture)
    write_transforms(tmp_path / "transforms.json", capture, [{"mask_path": "own.png"}] * VIEWS)
    write_mask(tmp_path / "own.png", ~LEFT)
    write_masks(tmp_path / "masks")
    write_masks(tmp_path / "others", np.ones_like(LEFT))
    own = load(TransformsConfig().build(request(tmp_path)))
    assert np.array_equal(own.valid[0, ..., 0], ~LEFT)
    others = load(TransformsConfig(masks="others").build(request(tmp_path)))
    assert bool(others.valid.all())
    assert load(TransformsConfig(masks="none").build(request(tmp_path))).mask is None


def test_inverted_masks_are_dark_where_pixels_count(folder):
    write_masks(folder / "masks")
    batch = load(open_colmap(folder, invert_masks=True))
    assert np.array_equal(batch.valid[0, ..., 0], ~LEFT)


def test_outside_an_empty_mask_is_background(folder):
    write_masks(folder / "masks")
    data = open_colmap(folder, mask_mode="empty")
    batch = load(data)
    assert batch.valid is None
    assert data.scene.has_alpha
    background = torch.tensor([0.25, 0.5, 0.75])
    target = batch.target(background)
    right = WIDTH // 2
    assert torch.equal(target[:, :, right:], background.expand_as(target[:, :, right:]))
    assert torch.equal(target[:, :, :right], batch.images[:, :, :right])
    assert (
        "pixels outside of the masks are background (datamanager.mask_mode=empty)"
        in mask_notes(data)[0]
    )


def test_the_edge_of_an_empty_mask_is_partly_covered_in_a_smaller_image(folder):
    inside = LEFT.copy()
    inside[:, WIDTH // 2] = True
    write_masks(folder / "masks", inside)
    batch = load(open_colmap(folder, downscale=2.0, mask_mode="empty"))
    assert sorted(batch.alpha.unique().tolist()) == pytest.approx([0, 128 / 255, 1])


def test_alpha_may_be_the_mask(folder):
    for name in ring(VIEWS).names:
        pixels = np.full((HEIGHT, WIDTH, 4), 200, np.uint8)
        pixels[..., 3] = 255 * LEFT
        Image.fromarray(pixels, "RGBA").save(folder / "images" / name)
    data = open_colmap(folder, masks="alpha")
    batch = load(data)
    assert (batch.alpha, data.scene.has_alpha) == (None, False)
    assert np.array_equal(batch.valid[0, ..., 0], LEFT)
    assert mask_notes(data) == [
        "alpha of 3 of 3 images is their mask: pixels outside of the masks have no loss "
        "(datamanager.mask_mode=ignore)"
    ]


def test_alpha_that_is_not_there_cannot_be_the_mask(folder):
    with pytest.raises(DataError) as error:
        open_colmap(folder, masks="alpha")
    assert str(error.value) == (
        f"datamanager.masks=alpha: none of the 3 images of {folder} has alpha.\n"
        "Give a folder of masks (datamanager.masks=DIR), or leave datamanager.masks out."
    )


@pytest.mark.parametrize("mode", ["ignore", "empty"])
def test_blank_borders_of_undistorted_images_carry_no_loss_whatever_masks_mean(tmp_path, mode):
    write_colmap(tmp_path, ring(VIEWS), model="SIMPLE_RADIAL", params=(FOCAL[0], *CENTER, STRONG))
    write_images(tmp_path / "images", ring(VIEWS))
    blank = load(open_colmap(tmp_path, blank_pixels=1.0)).valid
    assert 0 < float((~blank).float().mean()) < 0.5
    write_masks(tmp_path / "masks")
    both = load(open_colmap(tmp_path, blank_pixels=1.0, mask_mode=mode))
    half = both.valid.shape[2] // 2 - 4
    assert torch.equal(both.valid[:, 2:-2, 2:half], blank[:, 2:-2, 2:half])
    if mode == "ignore":
        assert not both.valid[:, :, -half:].any()
    else:
        assert torch.equal(both.valid, blank)
        assert float(both.alpha[:, :, -half:].max()) == 0


def test_a_mask_of_another_size_is_told_when_the_data_set_is_opened(folder):
    write_masks(folder / "masks")
    write_mask(folder / "masks/view_001.png", LEFT[:4, :5])
    with pytest.raises(DataError) as error:
        open_colmap(folder)
    assert str(error.value) == (
        f"{folder}/masks/view_001.png: the mask is 5x4 pixels, its image "
        f"{folder}/images/view_001.png is 64x48.\n"
        "A mask needs the size of its (upright) image."
    )


def test_masks_that_are_missing_or_leave_nothing_are_noted(folder):
    write_masks(folder / "masks")
    (folder / "masks/view_000.png").unlink()
    write_mask(folder / "masks/view_001.png", np.zeros_like(LEFT))
    data = open_colmap(folder)
    assert mask_notes(data) == [
        "2 of 3 images have masks, which keep 25 % of their pixels: pixels outside of the "
        "masks have no loss (datamanager.mask_mode=ignore)",
        "masks hide 1 image completely, and no figure includes it: view_001.png",
        "no mask, so that all pixels count: 1 images, such as view_000.png",
    ]
    assert bool(load(data).valid[0].all())


def test_masks_that_leave_nothing_of_any_image_are_refused(folder):
    write_masks(folder / "masks", np.zeros_like(LEFT))
    with pytest.raises(DataError) as error:
        open_colmap(folder)
    assert str(error.value) == (
        "the masks of all 3 images mask out every pixel, "
        f"{folder}/masks/view_000.png for one.\n"
        "Masks are bright where pixels count; if these are dark there, add "
        "datamanager.invert_masks=true."
    )


def test_a_named_folder_has_to_be_there_and_to_hold_masks(folder):
    with pytest.raises(DataError) as error:
        open_colmap(folder, masks="elsewhere")
    assert str(error.value) == (
        f"datamanager.masks=elsewhere: there is no folder {folder}/elsewhere.\n"
        "Give the folder of the masks, relative to the data set."
    )
    write_image(folder / "elsewhere/other.png")
    with pytest.raises(DataError) as error:
        open_colmap(folder, masks="elsewhere")
    assert str(error.value) == (
        f"{folder}/elsewhere contains no mask of any image (looked for view_000.png.png or "
        "view_000.png, in any image format; found other.png).\n"
        "Name masks as their images, with .png behind or instead of the extension."
    )


def test_a_folder_of_masks_that_belongs_to_no_image_is_noted(folder):
    write_image(folder / "masks/other.png")
    (note,) = mask_notes(open_colmap(folder))
    assert note == (
        f"{folder}/masks contains no mask of any image (looked for view_000.png.png or "
        "view_000.png, in any image format; found other.png): all pixels count"
    )


def test_a_mode_that_is_none_is_refused(folder):
    with pytest.raises(ConfigError) as error:
        open_colmap(folder, mask_mode="hide")
    assert str(error.value) == "datamanager.mask_mode=hide: expected ignore or empty."
