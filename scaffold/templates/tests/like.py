"""Tests of method my-part."""

from gsfw.api import Feature
from gsfw.testing import conformance

from my_part.method import MyPartConfig

test_conforms = conformance("method", "my-part")


def test_the_brightness_is_an_extra_channel():
    needs = MyPartConfig().needs()
    assert Feature.EXTRA in needs.features
    assert needs.extra_channels == 1
