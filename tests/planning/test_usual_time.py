"""Data of the user's own is trained on for a time that people wait for, unless they say more."""

import pytest
from support.small_captures import ring, write_images, write_transforms

from gsfw.core.errors import ConfigError
from gsfw.planning.asked import USUAL, Asked, asked_of, spelled_out
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve


@pytest.fixture
def data(tmp_path) -> str:
    write_transforms(tmp_path / "transforms.json", ring())
    write_images(tmp_path, ring())
    return str(tmp_path)


def resolved(**values: str) -> tuple[Settings, list[Layer]]:
    given = spelled_out([Layer(COMMAND_LINE, {"method": "3dgs", "device": "cpu", **values})])
    return resolve(installed(), given), given


def test_data_of_the_users_own_has_the_usual_time(data):
    assert asked_of(*resolved(data=data)) == Asked(USUAL)
    assert asked_of(*resolved(data=data, downscale="2")) == Asked(USUAL)
    assert asked_of(*resolved(data=data, minutes="1")) == Asked(1.0)


@pytest.mark.parametrize(
    "said", [{"steps": "300"}, {"preset": "paper"}, {"preset": "fast"}, {"rescale": "false"}]
)
def test_who_says_how_long_a_run_is_gets_that(data, said):
    assert asked_of(*resolved(data=data, **said)) is None


def test_the_built_in_scene_has_the_steps_of_its_method():
    assert asked_of(*resolved()) is None


def test_preset_paper_is_there_for_every_method_and_changes_rates_and_growth_alone():
    for method in installed().slot("method"):
        usual, _ = resolved(method=method)
        paper, _ = resolved(method=method, preset="paper")
        changed = {k: v for k, v in paper.flat().items() if v != usual.flat()[k]}
        assert all(key.startswith(("optim.", "strategy.")) for key in changed)
        assert paper.flat()["optim.cooldown"] == 0.0
        assert paper.preset == "paper"
    with pytest.raises(ConfigError, match="paper"):
        resolved(preset="papers")
