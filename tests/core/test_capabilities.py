"""Needs against capabilities: who fits, and how a mismatch is told."""

from dataclasses import replace

import pytest

from gsfw.core.cameras import CameraModel
from gsfw.core.capabilities import Capabilities, Feature, Needs, check_fit, fitting
from gsfw.core.errors import ConfigError

FULL = Capabilities(
    devices=frozenset({"cpu", "cuda"}),
    camera_models=frozenset(CameraModel),
    features=frozenset(Feature),
)
FAST = Capabilities(
    devices=frozenset({"cpu"}),
    camera_models=frozenset({CameraModel.PINHOLE}),
    features=frozenset({Feature.GRADIENT, Feature.SH}),
    max_channels=4,
    preference=10,
)
BROKEN = Capabilities(unavailable="no driver; install one", preference=20)

INSTALLED = {"reference": FULL, "fast": FAST, "broken": BROKEN}

PLAIN = Needs(features=frozenset({Feature.GRADIENT}))
ANTIALIASED = Needs(features=frozenset({Feature.ANTIALIAS, Feature.DEPTH}), channels=5)
FISHEYE = Needs(camera_models=frozenset({CameraModel.FISHEYE}))


def test_needs_add_up():
    both = PLAIN | ANTIALIASED | FISHEYE
    assert both.features == {Feature.GRADIENT, Feature.ANTIALIAS, Feature.DEPTH}
    assert both.camera_models == {CameraModel.FISHEYE}
    assert both.channels == 5


def test_everything_that_is_lacking_is_named():
    assert FULL.lacking(PLAIN | ANTIALIASED | FISHEYE, "cuda") == []
    assert FAST.lacking(ANTIALIASED | FISHEYE, "cuda") == [
        "device 'cuda'",
        "camera model 'fisheye'",
        "feature 'antialias'",
        "feature 'depth'",
        "5 channels (at most 4)",
    ]
    assert BROKEN.lacking(PLAIN, "cpu") == ["no driver; install one"]


def test_the_preferred_one_that_fits_everybody_comes_first():
    assert fitting({"method": PLAIN}, INSTALLED, "cpu") == ["fast", "reference"]
    assert fitting({"method": PLAIN, "data": FISHEYE}, INSTALLED, "cpu") == ["reference"]
    assert fitting({"method": PLAIN}, INSTALLED, "cuda") == ["reference"]
    assert fitting({"method": PLAIN}, INSTALLED, "mps") == []
    assert fitting({}, INSTALLED, "cpu") == ["fast", "reference"]


def test_equal_preference_is_settled_by_name():
    assert fitting({}, {"b": FULL, "a": FULL}, "cpu") == ["a", "b"]


def test_a_rasterizer_that_fits_passes():
    check_fit("fast", {"method '3dgs'": PLAIN}, INSTALLED, "cpu")


def test_a_mismatch_names_who_needs_what_and_who_fits():
    needs = {"method '3dgs'": PLAIN | ANTIALIASED, "data set 'fox'": FISHEYE}
    with pytest.raises(ConfigError) as caught:
        check_fit("fast", needs, INSTALLED, "cpu")
    assert str(caught.value) == (
        "rasterizer 'fast' does not fit:\n"
        "  method '3dgs' needs feature 'antialias'\n"
        "  method '3dgs' needs feature 'depth'\n"
        "  method '3dgs' needs 5 channels (at most 4)\n"
        "  data set 'fox' needs camera model 'fisheye'\n"
        "Rasterizers that fit here: reference."
    )


def test_a_rasterizer_with_its_own_numerics_fits_those_who_ask_for_no_others():
    able = {"own": replace(FULL, profile="narrow"), "any": FULL}
    asking = PLAIN | Needs(profile="wide")
    assert fitting({"method": asking | PLAIN}, able, "cpu") == ["any"]
    assert fitting({"method": PLAIN}, able, "cpu") == ["any", "own"]
    assert able["own"].lacking(asking, "cpu") == ["numerics 'wide' (it draws only with 'narrow')"]
    assert able["own"].lacking(Needs(profile="narrow"), "cpu") == []


def test_a_rasterizer_that_cannot_run_says_why():
    with pytest.raises(ConfigError) as caught:
        check_fit("broken", {"method": PLAIN}, INSTALLED, "cpu")
    assert str(caught.value) == (
        "rasterizer 'broken' cannot run here: no driver; install one\n"
        "Rasterizers that fit here: fast, reference."
    )


def test_a_device_that_is_not_supported_is_named_with_those_that_are():
    with pytest.raises(ConfigError) as caught:
        check_fit("fast", {"method": PLAIN}, INSTALLED, "mps")
    assert str(caught.value) == (
        "rasterizer 'fast' does not run on device 'mps' (it runs on: cpu).\n"
        "Rasterizers that fit here: none."
    )
