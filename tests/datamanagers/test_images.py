"""DecodedImage files."""

import struct
import tracemalloc
import zlib
from contextlib import suppress

import numpy as np
import pytest
from PIL import Image
from support.reader_faults import little_memory
from support.small_captures import HEIGHT, WIDTH, write_image

from gsfw.core.errors import DataError
from gsfw.datamanagers import images
from gsfw.datamanagers.images import decode, decode_mask, load_mask, read_header

ORIENTATION = 274


def save(path, image, **settings):
    image.save(path, **settings)
    return path


def loaded(path) -> np.ndarray:
    return decode(path, read_header(path))


@pytest.mark.parametrize(("form", "place"), [("PNG", 16), ("JPEG", 0), ("BMP", 18)])
def test_a_header_that_announces_more_than_the_file_can_hold_gets_no_memory(tmp_path, form, place):
    path = tmp_path / f"a.{form.lower()}"
    Image.new("RGB", (8, 6), (20, 30, 40)).save(path, form)
    content = bytearray(path.read_bytes())
    side = 9_000
    if form == "PNG":
        content[place : place + 8] = struct.pack(">II", side, side)
        content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    elif form == "JPEG":
        place = content.index(b"\xff\xc0") + 5
        content[place : place + 4] = struct.pack(">HH", side, side)
    else:
        content[place : place + 8] = struct.pack("<ii", side, side)
    path.write_bytes(content)
    header = read_header(path)
    assert (header.width, header.height) == (side, side)
    with little_memory(), pytest.raises(DataError, match=r"announces 9000x9000 pixels, which"):
        decode(path, header)


def test_a_chunk_that_announces_more_than_the_file_has_gets_no_memory(tmp_path):
    path = tmp_path / "a.png"
    pixels = np.random.default_rng(0).integers(0, 256, (6, 8, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(path)
    content = bytearray(path.read_bytes())
    place = content.index(b"IDAT") - 4
    content[place : place + 4] = struct.pack(">I", 200_000_000)
    path.write_bytes(content)
    header = read_header(path)
    tracemalloc.start()
    try:
        with suppress(DataError):
            decode(path, header)
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("form", ["PNG", "JPEG", "BMP", "WEBP"])
def test_a_large_image_of_one_colour_is_read(tmp_path, form):
    path = tmp_path / "a"
    Image.new("1" if form == "PNG" else "RGB", (3000, 2000)).save(path, form)
    assert decode(path, read_header(path)).shape == (2000, 3000, 3)


def test_a_large_image_is_decoded_without_further_copies(tmp_path):
    path = save(tmp_path / "a.jpg", Image.new("RGB", (3000, 2000), (20, 30, 40)))
    header = read_header(path)
    tracemalloc.start()
    try:
        size = decode(path, header).nbytes
        assert tracemalloc.get_traced_memory()[1] < 2 * size
    finally:
        tracemalloc.stop()


def test_grey_is_spread_over_the_channels(tmp_path):
    path = save(tmp_path / "grey.png", Image.new("L", (3, 2), 77))
    assert np.unique(loaded(path)).tolist() == [77]
    assert loaded(path).shape == (2, 3, 3)


def test_16_bits_keep_their_upper_8(tmp_path):
    values = np.array([[0, 255, 256, 65535]], np.uint16)
    path = save(tmp_path / "deep.png", Image.fromarray(values))
    assert loaded(path)[0, :, 0].tolist() == [0, 0, 1, 255]


def test_a_palette_is_looked_up(tmp_path):
    image = Image.new("P", (2, 2), 1)
    image.putpalette([0, 0, 0, 10, 20, 30])
    path = save(tmp_path / "palette.png", image)
    assert not read_header(path).has_alpha
    assert loaded(path)[0, 0].tolist() == [10, 20, 30]


def test_a_transparent_palette_entry_becomes_alpha(tmp_path):
    image = Image.new("P", (2, 1), 1)
    image.putpalette([0, 0, 0, 10, 20, 30])
    image.putpixel((0, 0), 0)
    path = save(tmp_path / "palette.png", image, transparency=0)
    assert read_header(path).has_alpha
    assert loaded(path)[0].tolist() == [[0, 0, 0, 0], [10, 20, 30, 255]]


def test_grey_with_alpha_keeps_its_alpha(tmp_path):
    path = save(tmp_path / "grey.png", Image.new("LA", (1, 1), (50, 60)))
    assert loaded(path)[0, 0].tolist() == [50, 50, 50, 60]


def test_a_transparent_grey_of_16_bits_becomes_alpha(tmp_path):
    grey = np.array([[1000, 2000]], np.uint16)
    path = save(tmp_path / "a.png", Image.fromarray(grey), transparency=2000)
    assert loaded(path).tolist() == [[[3, 3, 3, 255], [7, 7, 7, 0]]]


def test_cmyk_becomes_rgb(tmp_path):
    path = save(tmp_path / "print.jpg", Image.new("CMYK", (8, 8), (0, 255, 255, 0)))
    red, green, blue = loaded(path)[4, 4].tolist()
    assert red > 240
    assert max(green, blue) < 20


@pytest.mark.parametrize("extension", ["png", "jpg", "tif", "webp"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_applied_and_known_from_the_header(
    tmp_path, monkeypatch, orientation, extension
):
    monkeypatch.setattr(images, "STRIP", 5)
    upright = np.zeros((16, 32, 3), np.uint8)
    upright[:8, :16] = 250
    stored = {
        1: upright,
        2: upright[:, ::-1],
        3: upright[::-1, ::-1],
        4: upright[::-1],
        5: upright.transpose(1, 0, 2),
        6: upright.transpose(1, 0, 2)[::-1],
        7: upright.transpose(1, 0, 2)[::-1, ::-1],
        8: upright.transpose(1, 0, 2)[:, ::-1],
    }[orientation]
    exif = Image.Exif()
    exif[ORIENTATION] = orientation
    path = tmp_path / f"turned.{extension}"
    save(path, Image.fromarray(np.ascontiguousarray(stored)), exif=exif, quality=100)
    header = read_header(path)
    assert (header.width, header.height) == (32, 16)
    assert np.abs(loaded(path).astype(int) - upright).mean() < 4


def test_an_unknown_orientation_is_none(tmp_path):
    exif = Image.Exif()
    exif[ORIENTATION] = 42
    path = save(tmp_path / "odd.jpg", Image.new("RGB", (4, 2)), exif=exif)
    assert read_header(path).orientation == 1


def test_content_counts_not_the_extension(tmp_path):
    save(tmp_path / "image.png", Image.new("RGB", (4, 2)))
    path = (tmp_path / "image.png").rename(tmp_path / "image.jpg")
    assert loaded(path).shape == (2, 4, 3)


def test_an_empty_file_is_said_to_be_empty(tmp_path):
    path = tmp_path / "empty.jpg"
    path.touch()
    with pytest.raises(DataError) as error:
        read_header(path)
    assert str(error.value) == (
        f"{path}: the file is empty (0 bytes).\n"
        "Replace the file, or remove it: images that are missing are left out."
    )


def test_a_file_that_is_no_image_is_told_by_its_content(tmp_path):
    path = tmp_path / "page.jpg"
    path.write_text("<html>404 not found</html>")
    with pytest.raises(DataError, match="these 26 bytes are no PNG, JPEG, WEBP, TIFF, BMP image"):
        read_header(path)


def test_a_file_that_may_not_be_read_is_not_called_damaged(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    (tmp_path / "a.png").write_bytes(b"1")
    monkeypatch.setattr(images, "BoundedFile", refuse)
    with pytest.raises(DataError, match=r"a.png: the file cannot be read: Permission denied\."):
        read_header(tmp_path / "a.png")


def test_a_missing_file_is_said_to_be_missing(tmp_path):
    with pytest.raises(DataError, match=r"nowhere\.png: there is no such file"):
        read_header(tmp_path / "nowhere.png")


@pytest.mark.parametrize("extension", ["png", "jpg"])
def test_an_image_that_is_cut_off_fails_when_it_is_decoded(tmp_path, extension):
    path = tmp_path / f"cut.{extension}"
    write_image(path, 200, 100)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    header = read_header(path)
    with pytest.raises(DataError, match=rf"cut\.{extension}: the image does not decode: "):
        decode(path, header)


def test_floating_point_pixels_are_refused(tmp_path):
    path = save(tmp_path / "depth.tif", Image.fromarray(np.zeros((2, 2), np.float32)))
    with pytest.raises(DataError, match=r"depth\.tif: the pixels are floating-point numbers"):
        read_header(path)


@pytest.mark.parametrize(("bits", "is_read"), [(8, True), (16, False)])
def test_channels_of_16_bits_that_are_stored_apart_are_refused(tmp_path, bits, is_read):
    channels = np.arange(3 * HEIGHT * WIDTH).reshape(3, HEIGHT, WIDTH) % 200
    planes = channels.astype("<u2" if bits == 16 else "u1").tobytes()
    plane, start = len(planes) // 3, 38
    fields = [(256, 1, WIDTH), (257, 1, HEIGHT), (258, 3, 8), (259, 1, 1), (262, 1, 2)]
    fields += [(273, 3, 14), (277, 1, 3), (278, 1, HEIGHT), (279, 3, 26), (284, 1, 2)]
    content = struct.pack("<4sI3H", b"II*\0", start + len(planes), *[bits] * 3)
    content += struct.pack("<6I", *(start + number * plane for number in range(3)), *[plane] * 3)
    content += planes + struct.pack("<H", len(fields))
    for tag, count, value in fields:
        content += struct.pack("<HHII", tag, 4 if tag in (273, 279) else 3, count, value)
    (tmp_path / "a.tif").write_bytes(content + bytes(4))
    if is_read:
        pixels = decode(tmp_path / "a.tif", read_header(tmp_path / "a.tif"))
        assert np.array_equal(pixels, channels.transpose(1, 2, 0))
    else:
        with pytest.raises(DataError, match="16-bit channels apart"):
            read_header(tmp_path / "a.tif")


def test_a_mask_may_be_0_and_255_or_0_and_1(tmp_path):
    for bright in (1, 255):
        values = np.array([[0, bright]], np.uint8)
        path = save(tmp_path / f"mask{bright}.png", Image.fromarray(values))
        assert decode_mask(path).tolist() == [[False, True]]


def test_a_mask_of_another_size_is_refused(tmp_path):
    write_image(tmp_path / "image.png", 8, 6)
    mask = save(tmp_path / "mask.png", Image.new("L", (4, 3)))
    header = read_header(tmp_path / "image.png")
    with pytest.raises(DataError) as error:
        load_mask(mask, tmp_path / "image.png", header)
    assert str(error.value) == (
        f"{mask}: the mask is 4x3 pixels, its image {tmp_path / 'image.png'} is 8x6.\n"
        "A mask needs the size of its (upright) image."
    )
