"""Bench and stress choose rasterizers by the same names."""

import pytest
import torch

from gsfw.core.capabilities import Feature, Needs
from gsfw.core.config import AUTO
from gsfw.core.errors import ConfigError
from gsfw.core.render_settings import Validation
from gsfw.plugins.registry import installed
from gsfw.studies.entrants import choose_all, choose_on_device, entrant_of

NEEDS = {"a test": Needs(features=frozenset({Feature.GRADIENT}))}


def test_settings_follow_the_name_and_the_device_is_its_own():
    entrant = entrant_of("reference:chunk_mb=2", installed())
    assert entrant.name == "reference:chunk_mb=2"
    assert entrant.config.chunk_mb == 2.0
    assert (entrant.device, entrant.threads) == (torch.device("cpu"), (1, 2))
    assert entrant.settings.validation is Validation.CHEAP
    assert entrant.with_stages() is entrant.rasterizer


def test_both_choices_take_settings_and_refuse_wrong_ones():
    names = ["reference:pairs_mb=64"]
    (one,), left_out = choose_all(names, installed(), NEEDS)
    (other,) = choose_on_device(names, "cpu", installed(), NEEDS)
    assert one.config == other.config
    assert left_out == {}
    for choose in (
        lambda name: choose_all([name], installed(), NEEDS),
        lambda name: choose_on_device([name], "cpu", installed(), NEEDS),
    ):
        with pytest.raises(ConfigError, match="there is no setting 'pairs'"):
            choose("reference:pairs=1")
        with pytest.raises(ConfigError, match="no rasterizer 'referense'"):
            choose("referense:pairs_mb=1")


def test_auto_is_one_rasterizer_however_often_it_is_named():
    (automatic,) = choose_on_device([AUTO], "cpu", installed(), NEEDS)
    assert [
        e.name for e in choose_on_device([AUTO, automatic.name], "cpu", installed(), NEEDS)
    ] == [automatic.name]


def test_without_names_those_of_another_rule_are_left_out_with_the_reason():
    chosen, left_out = choose_all([], installed(), {})
    assert "reference" in [entrant.name for entrant in chosen]
    assert not left_out.keys() & {entrant.name for entrant in chosen}
    assert left_out["ray"].startswith("it renders by another rule than splatting's")
