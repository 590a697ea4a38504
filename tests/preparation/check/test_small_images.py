"""Images that are only looked at are decoded one at a time, and are the same as all others."""

import numpy as np
import pytest
import torch
from PIL import Image
from support.small_captures import request, ring, write_transforms

from gsfw.core.datamanager import Split
from gsfw.core.loop.area import shrink_batch
from gsfw.datamanagers.area import shrink_in_strips, shrink_values, to_values
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.preparation.check.small_images import load_small

WIDTH, HEIGHT = 700, 600


def capture(folder, mode="RGB", mask=False, **lens):
    """Views of smooth noise."""
    views = ring(views=2)
    generator = np.random.default_rng(3)
    for name in views.names:
        noise = generator.integers(0, 256, (40, 50, len(mode)), dtype=np.uint8)
        folder.mkdir(exist_ok=True)
        Image.fromarray(noise, mode).resize((WIDTH, HEIGHT)).save(folder / name)
        if mask:
            (folder / "masks").mkdir(exist_ok=True)
            Image.fromarray(noise[..., 0]).resize((WIDTH, HEIGHT)).save(folder / "masks" / name)
    settings = {"fl_x": 500.0, "fl_y": 500.0, "cx": 350.0, "cy": 300.0, "w": WIDTH, "h": HEIGHT}
    path = write_transforms(folder / "transforms.json", views, **settings, **lens)
    return TransformsConfig().build(request(path.parent))


@pytest.mark.parametrize(("mode", "mask"), [("RGB", False), ("RGBA", False), ("RGB", True)])
def test_a_small_image_has_the_means_of_the_whole_one(tmp_path, mode, mask):
    data = capture(tmp_path, mode, mask)
    (whole,) = data.load(Split.TRAIN, [1], torch.device("cpu"))
    wanted = shrink_batch(whole, 233, 200)
    small = load_small(data, Split.TRAIN, 1, 233, 200)
    white = torch.ones(3)
    torch.testing.assert_close(small.target(white), wanted.target(white), atol=2e-6, rtol=0)
    if mask:
        assert torch.equal(small.mask, wanted.mask)
    assert small.cameras.width == 233
    data.close()


def test_a_lens_is_undone_in_a_large_image_that_is_looked_at(tmp_path, monkeypatch):
    monkeypatch.setattr("gsfw.datamanagers.capture.SMALL_LENS", 0)
    data = capture(tmp_path, k1=0.1)
    camera = data.views(Split.TRAIN).cameras[0]
    (whole,) = data.load(Split.TRAIN, [0], torch.device("cpu"))
    width, height = camera.width // 3, camera.height // 3
    wanted = shrink_batch(whole, width, height)
    small = load_small(data, Split.TRAIN, 0, width, height)
    assert float((small.images - wanted.images).abs().mean()) < 4e-3
    data.close()


@pytest.mark.parametrize("rows", [100, 256, 700])
def test_strips_add_up_to_the_means_of_areas(rows):
    pixels = np.random.default_rng(1).integers(0, 256, (rows, 90, 4), dtype=np.uint8)
    wanted = shrink_values(to_values(pixels), 31, 47)
    np.testing.assert_allclose(shrink_in_strips(pixels, 31, 47), wanted, atol=1e-3)
