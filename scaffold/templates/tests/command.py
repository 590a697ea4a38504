"""Tests of verb my-part."""

import pytest
import torch
from gsfw.api import ConfigError
from gsfw.testing import conformance

from my_part.command import _spread, run

test_conforms = conformance("command", "my-part")


def test_the_spread_leaves_out_the_outermost_values():
    found = _spread(torch.arange(101.0), 0.05)
    assert found == {"low": 5.0, "middle": 50.0, "high": 95.0}


def test_a_share_out_of_range_is_refused():
    with pytest.raises(ConfigError, match="share=2"):
        run(["latest", "share=2"])
