"""Tests of gsfw.core.errors: the tracebacks of Python programs."""

import pickle
import traceback

import pytest

from gsfw.core.background import parse_background
from gsfw.core.errors import ConfigError, NotEnoughMemoryError, UserError, without_inner_frames
from gsfw.plugins.registry import PartError
from gsfw.plugins.specs import Spec


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


@pytest.mark.parametrize(
    "error",
    [
        ConfigError("no.", "Say yes."),
        NotEnoughMemoryError("full."),
        PartError("method", Spec("mine", "a part", "module:Name"), "it is broken", "Mend it."),
    ],
)
def test_an_error_crosses_to_another_process_with_its_texts(error):
    arrived = pickle.loads(pickle.dumps(error))
    assert type(arrived) is type(error)
    assert (str(arrived), arrived.message, arrived.advice) == (
        *(str(error), error.message, error.advice),
    )
    assert isinstance(arrived, UserError)
