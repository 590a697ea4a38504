"""What is read of each image of a source."""

from PIL import Image
from PIL.ExifTags import Base
from support.source_photos import names, photo

from gsfw.preparation.source import read_source


def test_sizes_are_those_of_the_upright_image(tmp_path):
    exif = Image.Exif()
    exif[Base.Orientation] = 6
    exif[Base.Model] = "Phone"
    photo(tmp_path / "a.jpg", exif=exif)
    (image,) = read_source([tmp_path]).images.images
    assert (image.header.width, image.header.height) == (6, 8)
    assert image.header.orientation == 6
    assert image.exif.model == "Phone"


def test_an_image_is_named_by_its_content(folder):
    photo(folder / "c.jpg", content="PNG")
    photo(folder / "d.txt", content="JPEG")
    photo(folder / "e", content="WEBP")
    photo(folder / "f.HEIC", content="JPEG")
    photo(folder / "2024.05.01", content="TIFF")
    photo(folder / "g.JPG", content="JPEG")
    source = read_source([folder])
    assert names(source) == [
        *("2024.05.01.tif", "a.png", "b.png", "c.png", "d.jpg", "e.webp", "f.jpg", "g.JPG"),
    ]
    assert source.notes == (
        "named by content, not by extension: 2024.05.01 -> 2024.05.01.tif, c.jpg -> c.png, "
        "d.txt -> d.jpg, e -> e.webp, f.HEIC -> f.jpg",
    )


def test_of_several_pages_the_first_is_used(folder):
    pages = [Image.new("RGB", (8, 6), (shade, 0, 0)) for shade in (10, 20, 30)]
    pages[0].save(folder / "c.tif", save_all=True, append_images=pages[1:])
    pages[0].save(folder / "d.png", save_all=True, append_images=pages[1:2])
    source = read_source([folder])
    assert names(source) == ["a.png", "b.png", "c.tif", "d.png"]
    assert source.notes == (
        "the first image is used of files that hold several: c.tif (3), d.png (2)",
    )


def test_previews_behind_a_jpeg_are_no_pages(tmp_path):
    pages = [Image.new("RGB", (8, 6), (shade, 0, 0)) for shade in (10, 20)]
    pages[0].save(tmp_path / "a.jpg", "MPO", save_all=True, append_images=pages[1:])
    source = read_source([tmp_path])
    assert (names(source), source.notes) == (["a.jpg"], ())


def test_much_smaller_images_are_used_and_told_of(tmp_path):
    for name in "abc":
        photo(tmp_path / f"{name}.png", (64, 48))
    photo(tmp_path / "d.png", (16, 12))
    photo(tmp_path / "e.png", (12, 15))
    source = read_source([tmp_path])
    assert len(names(source)) == 5
    assert source.notes == (
        "much smaller than the usual 64 pixels, perhaps thumbnails, which are better removed: "
        "e.png (12x15)",
    )


def test_damaged_exif_does_not_matter(tmp_path):
    photo(tmp_path / "a.jpg", exif=b"Exif\0\0II*\0\xff\xff\xff\xff")
    assert names(read_source([tmp_path])) == ["a.jpg"]


def test_one_image_is_no_error_here(tmp_path):
    assert names(read_source([photo(tmp_path / "a.png")])) == ["a.png"]
