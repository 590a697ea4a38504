"""Needs against capabilities: who fits, and how a mismatch is told."""

from dataclasses import replace

import pytest

from gsfw.core.cameras import CameraModel
from gsfw.core.capabilities import Capabilities, Feature, Needs, check_fit, fitting, of_splatting
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


def test_extra_channels_add_up_and_colours_do_not():
    both = Needs(channels=5, extra_channels=6) | Needs(channels=3, extra_channels=1)
    assert (both.channels, both.extra_channels) == (5, 7)


def test_more_extra_channels_than_fit_beside_the_colours_are_named():
    limited = replace(FULL, max_channels=40)
    assert limited.lacking(Needs(extra_channels=37), "cpu") == []
    assert limited.lacking(Needs(extra_channels=38), "cpu") == [
        "41 channels (38 extra), of which it renders at most 40 at once"
    ]
    assert FULL.lacking(Needs(extra_channels=1000), "cpu") == []
    deep = Needs(features=frozenset({Feature.DEPTH}), extra_channels=36)
    assert limited.lacking(deep, "cpu") == [
        "41 channels (36 extra, 2 for depth), of which it renders at most 40 at once"
    ]


def test_extra_channels_need_the_feature():
    assert FAST.lacking(Needs(extra_channels=1), "cpu") == ["feature 'extra channels'"]


def test_components_that_fit_alone_may_not_fit_together():
    limited = {"limited": replace(FULL, max_channels=40), "reference": FULL}
    needs = {"method 'features'": Needs(extra_channels=30), "strategy 'x'": Needs(extra_channels=9)}
    assert fitting(needs, limited, "cpu") == ["reference"]
    with pytest.raises(ConfigError) as caught:
        check_fit("limited", needs, limited, "cpu")
    assert str(caught.value) == (
        "rasterizer 'limited' does not fit:\n"
        "  all components together need 42 channels (39 extra), of which it renders at most 40 "
        "at once\n"
        "Rasterizers that fit here: reference."
    )


def test_everything_that_is_lacking_is_named():
    assert FULL.lacking(PLAIN | ANTIALIASED | FISHEYE, "cuda") == []
    assert FAST.lacking(ANTIALIASED | FISHEYE, "cuda") == [
        "device 'cuda'",
        "camera model 'fisheye'",
        "feature 'antialias'",
        "feature 'depth'",
        "7 channels (2 for depth), of which it renders at most 4 at once",
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
        "  method '3dgs' needs 7 channels (2 for depth), of which it renders at most 4 at once\n"
        "  data set 'fox' needs camera model 'fisheye'\n"
        "Rasterizers that fit here: reference."
    )


def test_a_rasterizer_with_its_own_numerics_fits_those_who_ask_for_no_others():
    able = {"own": replace(FULL, profile="narrow"), "any": FULL}
    asking = PLAIN | Needs(profile="wide")
    assert fitting({"method": asking | PLAIN}, able, "cpu") == ["any"]
    assert fitting({"method": PLAIN}, able, "cpu") == ["any", "own"]
    assert able["own"].lacking(asking, "cpu") == ["numerics 'wide' (it renders only with 'narrow')"]
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


def test_only_backends_of_splattings_rule_are_chosen_automatically():
    able = {"surfels": replace(FULL, rule="surfels", preference=99), "fast": FAST}
    assert list(of_splatting(able)) == ["fast"]
