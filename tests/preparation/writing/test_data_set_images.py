"""Images of data sets of estimated cameras: copied, turned, masked or written anew."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms
from PIL.ExifTags import Base
from support.distorted_images import HEIGHT, WIDTH, lens
from support.estimated_cameras import (
    CPU,
    VIEWS,
    estimate,
    frames,
    image,
    loaded,
    photos,
)

from gsfw.core.datamanager import Split
from gsfw.datamanagers.images import read_header
from gsfw.datamanagers.undistortion import LensRule
from gsfw.preparation.exif import Exif
from gsfw.preparation.image_set import ImageSet, SourceImage
from gsfw.preparation.writing.camera_plan import CameraPlan
from gsfw.preparation.writing.data_set import write_data_set
from gsfw.preparation.writing.image_output import OutputRule

KEEP = OutputRule("keep")
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def test_images_of_pinholes_are_copied(tmp_path):
    taken = photos(tmp_path / "photos")
    for model, distortion in (
        ("PINHOLE", ()),
        ("SIMPLE_PINHOLE", ()),
        ("OPENCV", (1e-5, 0.0, 0.0, 0.0)),
    ):
        out = tmp_path / model
        found = write_data_set(estimate(lens(model, distortion)), taken, out, OutputRule())
        assert {frame.lens.model for frame in frames(loaded(out))} == {"PINHOLE"}
        for one in taken.images:
            assert (out / "images" / one.name).read_bytes() == one.path.read_bytes()
    assert found.lens == "PINHOLE, as OPENCV was almost straight"
    assert found.sizes == ((WIDTH, HEIGHT),)


def test_kept_files_stay_byte_for_byte(tmp_path):
    names = [f"view_{view}.jpg" for view in range(VIEWS)]
    taken = photos(tmp_path / "photos", names, quality=80)
    found = write_data_set(estimate(lens("OPENCV"), names), taken, tmp_path, KEEP)
    for one in taken.images:
        assert (tmp_path / "images" / one.name).read_bytes() == one.path.read_bytes()
    assert found.lens == "OPENCV as given"
    assert found.bytes == sum(
        item.stat().st_size
        for part in ("images", "sparse")
        for item in (tmp_path / part).rglob("*.*")
    )


def turned(folder: Path, names) -> ImageSet:
    """JPEG files that lie on their side, with a tag that turns them upright."""
    exif = Image.Exif()
    exif[Base.Orientation], exif[Base.Make] = 6, "A maker"
    taken = []
    for view, name in enumerate(names):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        lying = Image.fromarray(image(view)).transpose(Image.Transpose.ROTATE_90)
        lying.save(path, quality=98, subsampling=0, exif=exif, icc_profile=PROFILE)
        taken.append(SourceImage(name, path, read_header(path), Exif()))
    return ImageSet(tuple(taken))


@pytest.mark.parametrize("rule", [OutputRule(), KEEP], ids=["pinhole", "keep"])
def test_turned_images_are_written_upright_without_the_tag(tmp_path, rule):
    names = [f"view_{view}.JPG" for view in range(VIEWS)]
    taken = turned(tmp_path / "photos", names)
    found = write_data_set(estimate(lens("OPENCV"), names), taken, tmp_path / "out", rule)
    with Image.open(tmp_path / "out/images/view_1.JPG") as opened:
        assert opened.format == "JPEG"
        assert opened.size == found.sizes[0]
        exif = opened.getexif()
        assert Base.Orientation not in exif
        assert exif[Base.Make] == "A maker"
        assert "icc_profile" not in opened.info
        assert [layer[1:3] for layer in opened.layer] == [(1, 1)] * 3
        if rule is KEEP:
            assert np.abs(np.asarray(opened).astype(int) - image(1)).max() < 12
    assert "images that only an EXIF tag turned are stored upright: 4" in found.notes
    assert loaded(tmp_path / "out").views(Split.TRAIN).names == tuple(names)


def test_a_turned_tiff_becomes_an_upright_png(tmp_path):
    names = [f"view_{view}.tif" for view in range(VIEWS)]
    taken = photos(tmp_path / "photos", names)
    for one in taken.images:
        with Image.open(one.path) as opened:
            lying = opened.transpose(Image.Transpose.ROTATE_90)
        lying.save(one.path, tiffinfo={Base.Orientation.value: 6})
    write_data_set(estimate(lens("OPENCV"), names), taken, tmp_path / "out", KEEP)
    assert loaded(tmp_path / "out").views(Split.TRAIN).names[0] == "view_0.png"
    with Image.open(tmp_path / "out/images/view_1.png") as opened:
        assert np.array_equal(np.asarray(opened), image(1))


def test_alpha_is_kept(tmp_path):
    taken = photos(tmp_path / "photos")
    for one in taken.images:
        alpha = np.full((HEIGHT, WIDTH, 1), 255, np.uint8)
        alpha[:, :100] = 0
        Image.fromarray(np.concatenate([image(0), alpha], axis=2)).save(one.path)
    taken = ImageSet(tuple(replace(one, header=read_header(one.path)) for one in taken.images))
    write_data_set(estimate(lens("OPENCV")), taken, tmp_path / "out", OutputRule())
    (batch,) = loaded(tmp_path / "out").load(Split.TRAIN, [0], CPU)
    assert batch.alpha is not None
    assert (float(batch.alpha.min()), float(batch.alpha.max())) == (0.0, 1.0)


def test_what_no_lens_saw_is_masked(tmp_path, monkeypatch):
    CameraPlan.of.cache_clear()
    wide = LensRule(blank_pixels=1.0)
    monkeypatch.setattr("gsfw.preparation.writing.camera_plan.LensRule", lambda: wide)
    taken = photos(tmp_path / "photos")
    found = write_data_set(estimate(lens("OPENCV")), taken, tmp_path, OutputRule())
    CameraPlan.of.cache_clear()
    assert "masks/ marks what lenses did not see" in found.notes
    assert (found.images, found.masks) == (4, 4)
    (batch,) = loaded(tmp_path).load(Split.TRAIN, [0], CPU)
    assert batch.valid is not None
    assert 0.5 < float(batch.valid.float().mean()) < 1


@pytest.mark.parametrize("rule", [OutputRule(), KEEP])
def test_masks_of_images_are_those_of_the_data_set(tmp_path, rule):
    taken = photos(tmp_path / "photos")
    inside = np.ones((HEIGHT, WIDTH), bool)
    inside[HEIGHT // 2 :] = False
    Image.fromarray(inside).save(tmp_path / "mask.png")
    first, *others = taken.images
    taken = ImageSet((replace(first, mask=tmp_path / "mask.png"), *others))
    found = write_data_set(estimate(lens("OPENCV")), taken, tmp_path / "out", rule)
    assert found.masks == 1
    data = loaded(tmp_path / "out")
    assert data.views(Split.TRAIN).names[0] == "view_0.png"
    (batch,) = data.load(Split.TRAIN, [0], CPU)
    assert batch.valid is not None
    assert batch.valid[:, : batch.valid.shape[1] // 3].all()
    assert not batch.valid[:, -batch.valid.shape[1] // 3 :].any()


def test_the_quality_is_that_of_rewritten_jpegs(tmp_path):
    names = [f"view_{view}.jpg" for view in range(VIEWS)]
    taken, estimated = photos(tmp_path / "photos", names), estimate(lens("OPENCV"), names)
    sizes = [
        write_data_set(estimated, taken, tmp_path, OutputRule(jpeg_quality=quality)).bytes
        for quality in (60, 95)
    ]
    assert sizes[0] < sizes[1]
    with Image.open(io.BytesIO((tmp_path / "images/view_0.jpg").read_bytes())) as image:
        assert image.format == "JPEG"
