"""What photos say of their cameras."""

from pathlib import Path

import pytest
from PIL import Image
from PIL.ExifTags import IFD, Base
from PIL.TiffImagePlugin import IFDRational

from gsfw.preparation.exif import Exif, read_exif

PHONE = {
    Base.Make: "Apple",
    Base.Model: "iPhone 12",
    Base.LensModel: "back camera 4.2mm f/1.6",
    Base.FocalLength: IFDRational(42, 10),
    Base.FocalLengthIn35mmFilm: 26,
    Base.DateTimeOriginal: "2024:05:01 12:30:00",
}


def save(path: Path, tags: dict[int, object], size: tuple[int, int] = (8, 6)) -> Path:
    """An image with these tags, each where Exif wants it."""
    exif = Image.Exif()
    exif[IFD.Exif] = {}  # Pillow 11.0 does not write what is added to an empty get_ifd().
    for tag, value in tags.items():
        place = exif if tag in (Base.Make, Base.Model, Base.Orientation) else exif[IFD.Exif]
        place[tag] = value
    Image.new("RGB", size, (90, 60, 30)).save(path, exif=exif.tobytes())
    return path


@pytest.mark.parametrize("extension", ["jpg", "png", "webp", "tif"])
def test_what_a_phone_writes_is_read(tmp_path, extension):
    exif = read_exif(save(tmp_path / f"photo.{extension}", PHONE))
    assert exif == Exif(
        make="Apple",
        model="iPhone 12",
        lens="back camera 4.2mm f/1.6",
        focal_mm=float(IFDRational(42, 10)),
        focal_35mm=26.0,
        taken="2024:05:01 12:30:00",
    )
    assert exif.names_camera


def test_an_image_without_exif_says_nothing(tmp_path):
    Image.new("RGB", (8, 6)).save(tmp_path / "plain.png")
    assert read_exif(tmp_path / "plain.png") == Exif()
    assert not Exif(taken="2024:05:01 12:30:00").names_camera


@pytest.mark.parametrize("orientation", [1, 6])
@pytest.mark.parametrize("size", [(8, 6), (40, 30), (36, 24)])
def test_the_focal_length_of_the_35_mm_equivalent_is_colmaps(tmp_path, size, orientation):
    import pycolmap

    tags = {**PHONE, Base.Orientation: orientation}
    path = save(tmp_path / "photo.jpg", tags, size)
    upright = size if orientation == 1 else size[::-1]
    bitmap = pycolmap.Bitmap.read(path, as_rgb=True)
    assert read_exif(path).focal_pixels(*upright) == pytest.approx(bitmap.exif_focal_length())


def test_50_mm_on_film_is_50_mm_on_film():
    assert Exif(focal_35mm=50.0).focal_pixels(3600, 2400) == pytest.approx(5000, rel=1e-3)


@pytest.mark.parametrize(("unit", "per_mm"), [(2, 1 / 25.4), (3, 0.1), (4, 1), (5, 1000)])
def test_the_resolution_of_the_sensor_gives_the_focal_length(tmp_path, unit, per_mm):
    tags = {
        Base.FocalLength: 4.0,
        Base.FocalPlaneXResolution: 2.0 / per_mm,
        Base.FocalPlaneResolutionUnit: unit,
    }
    exif = read_exif(save(tmp_path / "photo.jpg", tags))
    assert exif.pixels_per_mm == pytest.approx(2)
    assert exif.focal_pixels(8, 6) == pytest.approx(8)


def test_a_resolution_without_a_unit_is_in_inches(tmp_path):
    tags = {Base.FocalLength: 4.0, Base.FocalPlaneXResolution: 50.8}
    assert read_exif(save(tmp_path / "photo.jpg", tags)).focal_pixels(8, 6) == pytest.approx(8)


def test_a_unit_that_does_not_exist_says_nothing(tmp_path):
    tags = {
        Base.FocalLength: 4.0,
        Base.FocalPlaneXResolution: 50.8,
        Base.FocalPlaneResolutionUnit: 1,
    }
    assert read_exif(save(tmp_path / "photo.jpg", tags)).focal_pixels(8, 6) is None


def test_the_focal_length_of_a_resized_image_is_resized(tmp_path):
    tags = {
        Base.FocalLength: 4.0,
        Base.FocalPlaneXResolution: 508.0,
        Base.ExifImageWidth: 80,
        Base.ExifImageHeight: 60,
    }
    exif = read_exif(save(tmp_path / "photo.jpg", tags))
    assert exif.longer_edge == 80
    assert exif.focal_pixels(80, 60) == pytest.approx(80)
    assert exif.focal_pixels(8, 6) == pytest.approx(8)
    assert exif.focal_pixels(6, 8) == pytest.approx(8), "turned upright"


def test_the_35_mm_equivalent_holds_at_any_size():
    exif = Exif(focal_35mm=26.0, longer_edge=4032)
    assert exif.focal_pixels(403, 302) == pytest.approx(exif.focal_pixels(4030, 3020) / 10)


def test_nonsense_is_passed_over():
    assert Exif(focal_35mm=65535.0).focal_pixels(8, 6) is None
    assert Exif(focal_35mm=0.5).focal_pixels(8, 6) is None
    both = Exif(focal_35mm=65535.0, focal_mm=4.0, pixels_per_mm=2.0)
    assert both.focal_pixels(8, 6) == pytest.approx(8)
    assert Exif(focal_mm=4.0).focal_pixels(8, 6) is None


def test_zeros_and_fractions_of_nothing_are_empty(tmp_path):
    tags = {
        Base.Make: " \0\0",
        Base.FocalLength: IFDRational(4, 0),
        Base.FocalLengthIn35mmFilm: 0,
        Base.FocalPlaneXResolution: IFDRational(0, 0),
        Base.DateTimeOriginal: "0000:00:00 00:00:00",
    }
    assert read_exif(save(tmp_path / "photo.jpg", tags)) == Exif()


@pytest.mark.parametrize(
    "damaged",
    [
        b"Exif\0\0no tags at all",
        b"Exif\0\0II*\0\xff\xff\xff\xff",
        b"Exif\0\0II*\0\x08\0\0\0\xff\xff\x12\x01\x03\0\x01",
    ],
)
def test_damaged_exif_is_empty_and_warns_of_nothing(tmp_path, damaged):
    Image.new("RGB", (8, 6)).save(tmp_path / "photo.jpg", exif=damaged)
    assert read_exif(tmp_path / "photo.jpg") == Exif()


def test_no_image_at_all_says_nothing(tmp_path):
    (tmp_path / "text.jpg").write_text("no image")
    assert read_exif(tmp_path / "text.jpg") == Exif()
    assert read_exif(tmp_path / "missing.jpg") == Exif()


def test_padding_is_taken_off_names(tmp_path):
    exif = read_exif(save(tmp_path / "photo.jpg", {Base.Model: "COOLPIX  \0\0"}))
    assert exif.model == "COOLPIX"
