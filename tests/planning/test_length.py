"""A plan gives a sampler as many steps as it needs."""

import pytest
import torch

from gsfw.core.cameras import Cameras
from gsfw.core.datamanager import Views
from gsfw.core.loop.pace import Pace
from gsfw.planning.length import enough_steps
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve

GIVEN = {"method": "dynamic3dgs", "device": "cpu", "datamanager.moving": "true"}


def settings_of(decided) -> Settings:
    return resolve(installed(), [Layer(COMMAND_LINE, {**GIVEN, **decided})])


def views_at(times: int) -> Views:
    """Two cameras at each time."""
    cameras = tuple(
        Cameras(torch.eye(4)[None], torch.eye(3)[None], 8, 6, time=torch.tensor([time / times]))
        for time in range(times)
        for _ in range(2)
    )
    return Views(tuple(str(place) for place in range(2 * times)), cameras)


@pytest.mark.parametrize("times", [5, 150])
def test_a_schedule_has_a_step_for_every_time(times):
    decided = {"steps": 40, "eval_every": 20, "downscale": 2.0}
    found = enough_steps(decided, settings_of, views_at(times))
    assert found["steps"] >= times
    assert found["eval_every"] * 2 == found["steps"]
    assert found["downscale"] == 2.0
    assert (found == decided) == (times == 5), "left alone where it is enough"


def test_a_longer_schedule_is_walked_through_at_a_higher_pace_from_the_first_update_on():
    found = enough_steps({"steps": 40}, settings_of, views_at(150))
    pace = Pace.parse(settings_of(found).config.pace)
    assert found["steps"] > 40
    assert pace.step(40) == found["steps"]


def test_a_given_number_of_steps_is_left_alone():
    assert enough_steps({"downscale": 2.0}, settings_of, views_at(150)) == {"downscale": 2.0}
