"""Tests of gsfw.core.errors: the tracebacks of Python programs."""

import traceback

import pytest

from gsfw.core.background import parse_background
from gsfw.core.errors import ConfigError, without_inner_frames


def of_the_user():
    raise ConfigError("no.") from KeyError("cause")


def test_frames_of_the_user_and_the_cause_stay():
    with pytest.raises(ConfigError) as caught:
        without_inner_frames(of_the_user)()
    assert traceback.extract_tb(caught.tb)[-1].name == "of_the_user"
    assert isinstance(caught.value.__cause__, KeyError)


def test_frames_of_gsfw_do_not():
    with pytest.raises(ConfigError) as caught:
        without_inner_frames(parse_background)("pink")
    assert traceback.extract_tb(caught.tb)[-1].name == "called"
