"""Image files: what is written is what other programs read."""

import numpy as np
import pytest
import torch
from PIL import Image

from gsfw.core.errors import OutputError
from gsfw.rendering.channels import CHANNELS
from gsfw.rendering.exr import exr_bytes
from gsfw.rendering.image_files import write_image, write_values

av = pytest.importorskip("av", reason="PyAV is not installed (extra video)")


def noise(*shape):
    return torch.rand(*shape, generator=torch.Generator().manual_seed(0))


def decoded(path, form):
    with av.open(str(path)) as container:
        return next(container.decode(video=0)).to_ndarray(format=form)


def test_a_png_of_16_bits_keeps_them(tmp_path):
    image = noise(5, 7, 3)
    path = write_image(tmp_path / "a.png", image, "png16")
    assert np.array_equal(
        decoded(path, "rgb48le"), (image.double() * 65535).round().numpy().astype(np.uint16)
    )
    with Image.open(path) as picture:
        assert picture.size == (7, 5)


def test_a_jpeg_is_near_to_the_image(tmp_path):
    image = noise(2, 2, 3).repeat_interleave(16, 0).repeat_interleave(16, 1)
    with Image.open(write_image(tmp_path / "a.jpg", image, "jpg")) as picture:
        assert picture.format == "JPEG"
        assert np.abs(np.asarray(picture) / 255 - image.numpy()).mean() < 0.01


@pytest.mark.parametrize("size", [(1, 1), (16, 8), (33, 21)])
def test_an_exr_has_the_values_to_the_last_bit(tmp_path, size):
    image, path = 100 * noise(*size, 3) - 20, tmp_path / "a.exr"
    named = {name: plane.numpy() for name, plane in zip("RGB", image.unbind(2), strict=True)}
    path.write_bytes(exr_bytes(named))
    planes = decoded(path, "gbrpf32le")
    found = planes if planes.ndim == 3 and planes.shape[2] == 3 else planes.transpose(1, 2, 0)
    assert np.array_equal(found.astype(np.float32), image.numpy())


def test_values_of_one_colour_compress(tmp_path):
    assert len(exr_bytes({"Z": np.full((64, 64), 2.5, np.float32)})) < 2000


def test_channels_have_the_names_that_other_tools_expect(tmp_path):
    channels = [CHANNELS[name] for name in ("color", "depth", "normals", "error")]
    images = [noise(4, 4, 3), noise(4, 4), torch.zeros(4, 4, 3), noise(4, 4)]
    content = write_values(tmp_path / "a.exr", channels, images).read_bytes()
    listed = content[content.index(b"chlist") :]
    names = [b"B", b"G", b"R", b"Z", b"error", b"normals.X", b"normals.Y", b"normals.Z"]
    places = [listed.index(name + b"\0\x02\0\0\0") for name in names]
    assert places == sorted(places)


def test_channels_of_different_sizes_are_refused():
    with pytest.raises(ValueError, match="all of one size"):
        exr_bytes({"R": np.zeros((2, 2), np.float32), "G": np.zeros((2, 3), np.float32)})


def test_a_place_that_cannot_be_written_is_one_message(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        write_image(tmp_path / "file" / "a.png", noise(2, 2, 3), "png16")
