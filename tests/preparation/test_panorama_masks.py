"""Masks of panoramas: which are found, how they are cut, and what is told of wrong ones."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.cut_panoramas import cut, images, photos
from support.panorama_room import FULL_XMP, sphere

from gsfw.core.errors import ConfigError, DataError, UserError
from gsfw.datamanagers.images import decode_mask
from gsfw.datamanagers.mask_folder import MaskFolder
from gsfw.datamanagers.warp import MapCache
from gsfw.preparation.panorama_cutting import PanoramaRule
from gsfw.preparation.panorama_masks import PanoramaMasks
from gsfw.preparation.panorama_views import DIRECTIONS, continued, cut_mask, view_side
from gsfw.preparation.panorama_views import cut as cut_view
from gsfw.preparation.preparation import Preparation
from gsfw.preparation.preparation_rule import PreparationRule
from gsfw.preparation.sift import ImageTask, find_features
from gsfw.preparation.source import read_source
from gsfw.preparation.workspace import Workspace


def panoramas(folder: Path, *names: str) -> Path:
    for number, name in enumerate(names):
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.roll(sphere(), number, axis=1)).save(place, xmp=FULL_XMP)
    return folder


def mask(path: Path, width: int = 256) -> Path:
    """The operator stands below, from 30 degrees under the horizon on."""
    path.parent.mkdir(parents=True, exist_ok=True)
    bright = np.full((width // 2, width), 255, np.uint8)
    bright[width // 3 :] = 0
    Image.fromarray(bright).save(path)
    return path


def masks_of(found) -> list[Path | None]:
    return [one.mask for one in found.images]


@pytest.mark.slow
def test_masks_have_the_geometry_of_views():
    random = np.random.default_rng(0)
    bright = np.kron(random.random((16, 32)) > 0.5, np.ones((64, 64), bool))
    colors = np.where(bright, 255, 0).astype(np.uint8)[..., None].repeat(3, axis=2)
    for direction in DIRECTIONS:
        side = view_side(bright.shape[1])
        colored = cut_view(continued(colors), direction, MapCache())[..., 0] > 127
        # Kernels and the nearest pixel differ at edges alone.
        assert (cut_mask(bright, side, direction) == colored).mean() > 0.995


@pytest.mark.slow
def test_one_mask_serves_panoramas_of_any_size(tmp_path):
    folder = panoramas(photos(tmp_path), "a.jpg")
    Image.fromarray(sphere()).resize((1024, 512)).save(folder / "b.jpg", xmp=FULL_XMP)
    given = PanoramaMasks(str(mask(tmp_path / "operator.png")))
    found, said = cut(images(folder), tmp_path, views="sphere", masks=given)
    assert "and so are their masks; 2 views" in said[0]
    for one in found.images:
        assert one.mask is not None
        inside = decode_mask(one.mask)
        assert inside.shape == (one.header.height, one.header.width)
        assert inside.all() == one.name.endswith("up.jpg")
    times = [one.mask.stat().st_mtime_ns for one in found.images]
    again, _ = cut(images(folder), tmp_path, views="sphere", masks=given)
    assert [one.mask.stat().st_mtime_ns for one in again.images] == times
    bare, _ = cut(images(folder), tmp_path, views="sphere", masks=PanoramaMasks("none"))
    assert masks_of(bare) == [None] * 16
    assert set((tmp_path / "views").iterdir()) == {one.path for one in bare.images}


def test_views_that_a_mask_hides_are_left_out(tmp_path):
    folder = panoramas(photos(tmp_path), "a.jpg", "b.jpg")
    given = PanoramaMasks(str(mask(tmp_path / "operator.png")))
    found, said = cut(images(folder), tmp_path, views="sphere", masks=given)
    names = [f"{name}_{one.name}.jpg" for name in "ab" for one in DIRECTIONS[:-1]]
    assert [one.name for one in found.images] == names
    assert "cut into 14 views of" in said[0]
    assert "; 2 views without a pixel that counts left out; panoramas=false" in said[0]


def test_a_panorama_that_its_mask_hides_is_left_out_with_the_reason(tmp_path):
    folder = panoramas(photos(tmp_path), "a.jpg", "b.jpg")
    (tmp_path / "masks").mkdir()
    Image.new("L", (64, 32)).save(tmp_path / "masks" / "a.png")
    given = PanoramaMasks(str(tmp_path / "masks"))
    found, _ = cut(images(folder), tmp_path, masks=given)
    assert [one.name for one in found.images] == [f"b_{one.name}.jpg" for one in DIRECTIONS[:6]]
    (lost,) = found.left_out
    assert (lost.name, lost.reason) == ("a.jpg", "its mask hides all views of it")
    (folder / "b.jpg").unlink()
    with pytest.raises(DataError, match=r"be used\. Its mask hides all views"):
        cut(images(folder), tmp_path, masks=given)


@pytest.mark.parametrize(
    "place", ["photos/masks/a.png", "photos/masks/a.jpg.png", "photos/masks/mask_a.tif"]
)
def test_masks_are_found_beside_panoramas(tmp_path, place):
    folder = panoramas(photos(tmp_path), "a.jpg", "b.jpg")
    given = images(folder)
    mask(tmp_path / place)
    found, said = cut(given, tmp_path)
    assert [one is not None for one in masks_of(found)] == [True] * 6 + [False] * 6
    assert "; masks were found for 1 of them; panoramas=false" in said[0]


def test_masks_are_found_beside_the_folder_of_images(tmp_path):
    panoramas(tmp_path, "walk/images/day/a.jpg")
    mask(tmp_path / "walk/masks/day/a.png")
    found, _ = cut(read_source([tmp_path / "walk"]).images, tmp_path)
    assert None not in masks_of(found)


def test_one_mask_serves_all_frames_of_a_video(tmp_path):
    folder = panoramas(photos(tmp_path), "000001.jpg", "000002.jpg")
    given = PanoramaMasks(str(mask(tmp_path / "operator.png")))
    found, _ = cut(images(folder, video="walk"), tmp_path, panoramas="true", masks=given)
    assert None not in masks_of(found)


def test_a_mask_among_the_photos_is_no_photo(tmp_path):
    folder = panoramas(photos(tmp_path), "a.jpg")
    operator = mask(folder / "operator.png")
    source = read_source([folder], apart=[operator])
    assert [one.name for one in source.images.images] == ["a.jpg"]


@pytest.mark.parametrize("inner", ["", "images/"])
def test_a_missing_mask_and_a_folder_of_photos_are_refused_before_anything_is_decoded(
    tmp_path, inner
):
    photos = tmp_path / "walk" / inner
    photos.mkdir(parents=True)
    (photos / "a.mp4").write_bytes(b"no video")
    for given, expected in (
        (tmp_path / "missing", "missing: there is no such file or folder.\nGive one image for"),
        (photos, "this is a folder of input images, and images of a folder of masks are not used"),
    ):
        rule = PreparationRule(panoramas=PanoramaRule(masks=PanoramaMasks(str(given))))
        place = Workspace(tmp_path / "out")
        with pytest.raises(UserError) as caught:
            Preparation((tmp_path / "walk",), place, rule, lambda line: None).run()
        assert f"panorama_masks={given}: " in str(caught.value)
        assert expected in str(caught.value)


def test_panoramas_of_one_name_in_two_folders_do_not_share_a_mask(tmp_path):
    panoramas(tmp_path, "in/left/001.jpg", "in/right/001.jpg", "in/right/002.jpg")
    given = read_source([tmp_path / "in"]).images
    for name in ("001.png", "002.png"):
        mask(tmp_path / "masks" / name)
    found, _ = cut(given, tmp_path, masks=PanoramaMasks(str(tmp_path / "masks")))
    assert [one is not None for one in masks_of(found)] == [False] * 12 + [True] * 6
    (tmp_path / "masks/002.png").unlink()
    with pytest.raises(DataError, match=r"looked for left/001.jpg.png or left/001.png, in any"):
        cut(given, tmp_path, masks=PanoramaMasks(str(tmp_path / "masks")))
    mask(tmp_path / "masks/right/001.png")
    found, _ = cut(given, tmp_path, masks=PanoramaMasks(str(tmp_path / "masks")))
    assert [one is not None for one in masks_of(found)] == [False] * 6 + [True] * 6 + [False] * 6


def test_a_folder_of_masks_is_listed_once_for_all_panoramas(tmp_path, monkeypatch):
    folder = panoramas(photos(tmp_path), "a.jpg", "b.jpg", "c.jpg")
    given = images(folder)
    listed = []
    usual = MaskFolder.files.func
    monkeypatch.setattr(MaskFolder.files, "func", lambda own: listed.append(own) or usual(own))
    mask(folder / "masks" / "a_mask.png")
    cut(given, tmp_path)
    assert listed == [MaskFolder(folder / "masks")]


def test_masked_pixels_have_no_features(tmp_path):
    folder = panoramas(photos(tmp_path), "a.jpg")
    found, _ = cut(images(folder), tmp_path, masks=PanoramaMasks(str(mask(tmp_path / "m.png"))))
    view = found.images[0]
    features = find_features(ImageTask("a", view.path, view.header, 400, 400, 400, 50, view.mask))
    bare = find_features(ImageTask("a", view.path, view.header, 400, 400, 400, 50))
    columns, rows = features.keypoints[:, :2].astype(int).T
    assert 0 < len(rows) < len(bare.keypoints)
    assert decode_mask(view.mask)[rows, columns].all()


def test_masks_that_cannot_be_used_are_refused(tmp_path):
    folder = panoramas(photos(tmp_path), "a.jpg")
    (tmp_path / "other").mkdir()
    square = tmp_path / "square.png"
    Image.new("L", (64, 64)).save(square)
    for path, expected in (
        (tmp_path / "other", "no mask of any panorama (looked for a.jpg.png or a.png, in any"),
        (square, "the mask is 64x64 pixels, and its panorama"),
    ):
        with pytest.raises(DataError) as caught:
            cut(images(folder), tmp_path, masks=PanoramaMasks(str(path)))
        assert expected in caught.value.message
    with pytest.raises(ConfigError, match="no image is cut as a panorama"):
        cut(images(folder), tmp_path, panoramas="false", masks=PanoramaMasks(str(square)))
