"""Tests of gsfw.core.background: colours as tensors."""

import pytest
import torch

from gsfw.core.background import background_tensor
from gsfw.core.errors import ConfigError


@pytest.mark.parametrize("wrong", [["a", 1, 2], object(), [[1, 2], [3]], "pink"])
def test_what_is_no_colour_is_refused(wrong):
    with pytest.raises(ConfigError, match=r"background=.*: expected white, black, auto, or"):
        background_tensor(wrong)


@pytest.mark.parametrize("given", ["0.1,0.2,0.3", (0.1, 0.2, 0.3), [0.1, 0.2, 0.3]])
def test_numbers_have_the_precision_that_is_asked_for(given):
    assert background_tensor(given, dtype=torch.float64).tolist() == [0.1, 0.2, 0.3]
    assert background_tensor(given).dtype == torch.float32
