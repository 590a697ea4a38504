"""FLIP is the package's figure over the valid pixels, and its absence is told with what to do."""

import sys

import pytest
import torch

from gsfw.core.maths import flip as module
from gsfw.studies.tradeoff.finished_model import LeftOut
from gsfw.studies.tradeoff.flip import flip, left_out


@pytest.fixture
def package():
    return pytest.importorskip(module.PACKAGE)


def images(noise):
    """A photo of 24x32, and the same with noise of this deviation."""
    generator = torch.Generator().manual_seed(1)
    photo = torch.rand(24, 32, 3, generator=generator)
    return photo + noise * torch.randn(photo.shape, generator=generator), photo


def test_equal_images_do_not_differ_and_worse_ones_differ_more(package):
    _, photo = images(0.0)
    found = [flip(images(noise)[0], photo, None) for noise in (0.0, 0.05, 0.2)]
    assert found[0] == 0.0
    assert 0.0 < found[1] < found[2] < 1.0


def test_without_a_mask_it_is_the_mean_of_the_package(package):
    rendered, photo = (image.clamp(0, 1) for image in images(0.1))
    _, expected, _ = package.evaluate(
        photo.numpy(), rendered.numpy(), "LDR", inputsRGB=True, applyMagma=False
    )
    assert flip(rendered, photo, None) == pytest.approx(expected, abs=1e-6)


def test_values_out_of_range_are_those_at_its_ends(package):
    _, photo = images(0.0)
    beyond = photo.where(photo > 0.1, -3.0).where(photo < 0.9, 3.0)
    assert flip(beyond, photo, None) == flip(beyond.clamp(0, 1), photo, None) > 0.0


def test_pixels_that_are_not_valid_do_not_count(package):
    _, photo = images(0.0)
    valid = torch.ones(24, 32, 1, dtype=torch.bool)
    valid[:, :10] = False
    wrong_outside, wrong_inside = photo.clone(), photo.clone()
    wrong_outside[:, :10] = 0.0
    wrong_inside[:, 20:] = 0.0
    assert flip(wrong_outside, photo, None) > 0.0
    assert flip(wrong_outside, photo, valid) == 0.0
    # The same error is of a part of 22 columns, no more of 32; none reaches those left out.
    expected = flip(wrong_inside, photo, None) * 32 / 22
    assert flip(wrong_inside, photo, valid) == pytest.approx(expected, rel=1e-4)


def test_nothing_is_left_out_where_the_package_is_there(package):
    assert left_out() == []


def test_without_the_package_it_is_left_out_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, module.PACKAGE, None)
    assert left_out() == [
        LeftOut("flip", "flip-evaluator is not installed; pip install 'gsfw[flip]'")
    ]


def test_a_package_that_does_not_load_says_why(monkeypatch):
    def broken(name):
        raise ImportError("wrong ELF class")

    monkeypatch.setattr(module, "import_module", broken)
    assert module.unavailable() == (
        "flip-evaluator cannot be loaded (wrong ELF class); "
        "pip install --force-reinstall flip-evaluator"
    )
