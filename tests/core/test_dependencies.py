"""Tests of gsfw.core.dependencies."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import pytest

from gsfw.core.dependencies import unmet_dependencies


@dataclass
class Inner:
    acts_with: ClassVar[Mapping[str, str]] = {"": "enabled=true"}
    enabled: bool = True
    size: int = 1


@dataclass
class Outer:
    acts_with: ClassVar[Mapping[str, str]] = {
        "rate": "count>0 or word!=none",
        "inner.size": "mode!=none",
    }
    rate: float = 1.0
    count: int = 0
    word: str = "none"
    mode: str = "none"
    inner: Inner = field(default_factory=Inner)


def conditions(config: object) -> dict[str, str]:
    return {item.key: item.condition for item in unmet_dependencies(config)}


def test_conditions_that_do_not_hold_are_named_with_their_whole_keys():
    assert conditions(Outer()) == {"rate": "count>0 or word!=none", "inner.size": "mode!=none"}


def test_one_alternative_is_enough():
    assert conditions(Outer(count=1, mode="some")) == {}
    assert conditions(Outer(word="auto", mode="some")) == {}


def test_a_group_that_is_off_covers_all_its_settings_but_its_switch():
    (unmet,) = unmet_dependencies(Outer(count=1, mode="some", inner=Inner(enabled=False)))
    assert (unmet.key, unmet.condition) == ("inner", "inner.enabled=true")
    assert unmet.covers("inner.size")
    assert not unmet.covers("inner.enabled")
    assert not unmet.covers("inner_size")


def test_a_declaration_that_is_no_condition_is_named():
    @dataclass
    class Wrong:
        acts_with: ClassVar[Mapping[str, str]] = {"rate": "count >= 1"}
        rate: float = 1.0
        count: int = 0

    with pytest.raises(ValueError, match=r"Wrong.acts_with: 'count >= 1' is no condition"):
        unmet_dependencies(Wrong())
