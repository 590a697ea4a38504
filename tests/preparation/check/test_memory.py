"""Looking at large photos takes little memory, however many there are."""

import shutil

import numpy as np
import pytest
import torch
from PIL import Image
from support.small_captures import request, ring, write_transforms

from gsfw.core.loop.memory import added_memory_mb
from gsfw.datamanagers.transforms import TransformsConfig
from gsfw.preparation.check.survey import Survey

COUNT, SIDE = 24, 2800


@pytest.mark.slow
def test_decoded_photos_are_not_kept(tmp_path):
    views = ring(views=COUNT)
    noise = np.random.default_rng(3).integers(0, 256, (40, 40, 3), dtype=np.uint8)
    first, *others = (tmp_path / name for name in views.names)
    # The content tells the format, not the name.
    Image.fromarray(noise).resize((SIDE, SIDE)).save(first, "JPEG")
    for path in others:
        shutil.copy(first, path)
    middle = {"cx": SIDE / 2, "cy": SIDE / 2, "w": SIDE, "h": SIDE}
    lens = {"fl_x": 2000.0, "fl_y": 2000.0}
    write_transforms(tmp_path / "transforms.json", views, **middle, **lens)
    data = TransformsConfig().build(request(tmp_path, cache_megabytes=2048))
    decoded = COUNT * SIDE * SIDE * 3 / 1e6
    added = added_memory_mb(lambda: Survey.of(data, 0), torch.device("cpu"))
    data.close()
    assert added is None or added < 0.6 * decoded
