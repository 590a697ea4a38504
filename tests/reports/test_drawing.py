"""Choice of the drawn views, colours of errors, and sizes of the files."""

import sys
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
import torch
from PIL import Image

from gsfw.core.errors import DataError, UnavailableError
from gsfw.core.loop.run_folder import RunFolder
from gsfw.reports.drawing import choose_views
from gsfw.reports.encoding import animated_webp, fitted, webp
from gsfw.reports.error_image import ErrorImage, choose_error, in_colors
from gsfw.reports.pictures import Pictures, ViewPicture, store_pictures, stored_pictures


def noise(height, width, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def test_of_many_views_the_worst_the_median_and_the_best_are_drawn():
    names = [str(place) for place in range(50)]
    assert choose_views(names, 9) == [
        *((str(place), "worst") for place in range(5)),
        *(("24", "median"), ("25", "median")),
        *(("48", "best"), ("49", "best")),
    ]
    assert [label for _, label in choose_views(names, 3)] == ["worst", "median", "best"]
    assert choose_views(names, 1) == [("0", "worst")]


@pytest.mark.parametrize("count", [0, 1, 2, 5, 9, 10, 11, 100])
@pytest.mark.parametrize("most", [1, 2, 3, 4, 9, 18])
def test_no_view_is_drawn_twice_and_their_order_stays(count, most):
    names = [str(place) for place in range(count)]
    chosen = [int(name) for name, _ in choose_views(names, most)]
    assert chosen == sorted(set(chosen))
    assert len(chosen) == min(count, most)
    assert chosen[:1] == [0][:count]


def test_even_noise_fits_into_the_bytes_that_are_given():
    assert len(webp(noise(480, 480), 36_000)) <= 36_000
    film = animated_webp([noise(100, 140, seed) for seed in range(8)], 100, 30_000)
    assert len(film) <= 30_000
    with Image.open(BytesIO(film)) as image:
        assert image.n_frames == 8


def test_images_are_shrunk_by_area_and_never_enlarged():
    image = torch.rand(60, 90, 3)
    assert fitted(image, 30).shape == (20, 30, 3)
    assert fitted(image, 200).shape == (60, 90, 3)
    assert abs(float(fitted(image, 30).mean()) / 255 - float(image.mean())) < 0.01


def test_equal_images_are_black_and_larger_errors_brighter():
    photo = np.full((24, 32, 3), 100, np.uint8)
    absolute = ErrorImage(is_flip=False)
    assert absolute.draw(photo, photo).max() <= 4
    means = [absolute.draw(photo + np.uint8(step), photo).mean() for step in (5, 20, 60)]
    assert means == sorted(means)
    assert in_colors(np.array([[np.nan, 2.0, -1.0]])).shape == (1, 3, 3)


def test_flip_is_drawn_where_it_is_installed():
    pytest.importorskip("flip_evaluator")
    assert choose_error("auto").is_flip
    assert "FLIP" in choose_error("auto").words
    photo, other = noise(24, 32), noise(24, 32, 1)
    assert choose_error("auto").draw(photo, photo).max() <= 4
    assert choose_error("auto").draw(other, photo).mean() > 50


def test_without_its_package_errors_are_absolute_and_say_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert not choose_error("auto").is_flip
    assert "absolute error" in choose_error("auto").words
    with pytest.raises(UnavailableError, match=r"error=flip: flip-evaluator is not installed"):
        choose_error("flip")


def pictures():
    image = webp(noise(4, 6), 10_000)
    views = tuple(ViewPicture(f"<{i}>", "worst", 20.0 + i, image, image, image) for i in range(2))
    views = (replace(views[0], own={"a/depth": webp(noise(5, 6), 10_000)}), views[1])
    return Pictures(5, "eval", "absolute", views, image, "<0>", image, True)


def test_pictures_are_read_as_they_were_stored(tmp_path):
    folder = RunFolder(tmp_path)
    assert stored_pictures(folder) is None
    store_pictures(folder, pictures())
    assert stored_pictures(folder) == pictures()


BOMB = (
    b"RIFF" + (22).to_bytes(4, "little") + b"WEBPVP8X" + (10).to_bytes(4, "little")
    + bytes(4) + (16_383).to_bytes(3, "little") + (16_383).to_bytes(3, "little")
)  # fmt: skip
"""A header of 268 million pixels."""


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("pictures.json", b"{"),
        ("pictures.json", b'{"schema": 1}'),
        ("pictures.json", b'{"schema": 99}'),
        ("pictures.json", b'{"schema": 1, "views": [], "step": 1e400}'),
        ("00_target.webp", b"no image"),
        ("orbit.webp", b""),
        ("still.webp", BOMB),
        ("still.webp", webp(noise(40, 40), 10_000)[:100]),
    ],
)
def test_damaged_pictures_are_refused_in_a_sentence(tmp_path, name, content):
    folder = RunFolder(tmp_path)
    store_pictures(folder, pictures())
    (tmp_path / "report" / name).write_bytes(content)
    with pytest.raises(DataError) as caught:
        stored_pictures(folder)
    assert "gsfw report" in caught.value.advice
    assert "\n" not in caught.value.message
