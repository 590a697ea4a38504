"""The ranges that built-in parts declare: defaults are within, and numbers beyond are refused."""

import math
from dataclasses import fields, is_dataclass

import pytest

from gsfw.core.errors import ConfigError
from gsfw.core.ranges import RANGE, check_ranges
from gsfw.plugins.registry import installed
from gsfw.plugins.specs import PROJECT

SLOTS = ("method", "strategy", "sampler", "rasterizer", "datamanager", "callback", "exporter")
PARTS = [
    (slot, name)
    for slot in SLOTS
    for name, spec in installed().slot(slot).items()
    if spec.distribution == PROJECT
]


def bounded(config, prefix=""):
    """Every number with a range: the configuration that has it, its name, its key and its range."""
    for item in fields(config):
        value = getattr(config, item.name)
        if is_dataclass(value):
            yield from bounded(value, f"{prefix}{item.name}.")
        elif RANGE in item.metadata:
            yield config, item.name, f"{prefix}{item.name}", item.metadata[RANGE]


def beyond(bounds):
    """Numbers out of a range, at each of its ends."""
    ends = {bounds.at_least: -1, bounds.above: 0, bounds.at_most: 1, bounds.below: 0}
    return [math.nan, *(end + step for end, step in ends.items() if end is not None)]


@pytest.mark.parametrize(("slot", "name"), PARTS)
def test_every_number_beyond_its_range_is_refused_by_its_key(slot, name):
    config = installed().slot(slot)[name].load()()
    if not is_dataclass(config):
        pytest.skip("it has no settings")
    check_ranges(config)
    for owner, field, key, bounds in bounded(config, "part."):
        default = getattr(owner, field)
        for value in beyond(bounds):
            object.__setattr__(owner, field, value)
            with pytest.raises(ConfigError) as caught:
                check_ranges(config, "part.")
            assert caught.value.message.startswith(f"{key}=")
            assert caught.value.message.endswith(f": expected {bounds}.")
        object.__setattr__(owner, field, default)
