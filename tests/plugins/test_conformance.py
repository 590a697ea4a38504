"""Tests of gsfw.plugins.conformance: parts of third parties that break their contract."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import pytest
from support.fake_parts import FakePlugin, registry_of

from gsfw.core.callback import Callback
from gsfw.core.config import SamplerConfig, StrategyConfig
from gsfw.core.metrics import Metric
from gsfw.core.sampler import Sampler
from gsfw.plugins.conformance import problem_of, signature_problem
from gsfw.plugins.loading import check_built, load, load_all
from gsfw.plugins.registry import PartError
from gsfw.plugins.specs import Spec, hookimpl


class Plain:
    pass


class Forgotten(StrategyConfig):
    share: int = 1

    def refiners(self, scene):
        raise NotImplementedError


@dataclass
class WithoutDefault(SamplerConfig):
    share: int

    def build(self, views, seed, steps):
        raise NotImplementedError


@dataclass
class OddType(StrategyConfig):
    made_by: Callable[[], int] = print

    def refiners(self, scene):
        raise NotImplementedError


@dataclass
class Abstract(StrategyConfig):
    share: int = 1


@dataclass
class OldBuild(SamplerConfig):
    def build(self, views):
        raise NotImplementedError


@dataclass
class Failing(StrategyConfig):
    share: list[int] = field(default_factory=lambda: 1 // 0)

    def refiners(self, scene):
        raise NotImplementedError


class OldMetric(Metric):
    def __call__(self, rendered, target):
        return 0.0


class OldCallback(Callback):
    def on_step(self, report):
        """Control came later."""


@dataclass
class Sound(SamplerConfig):
    shown: ClassVar[dict[str, Any]] = {}
    share: float | None = None

    def build(self, data, seed, steps, extra=None):
        """Names of arguments are its own, and it may take more."""


def verb(arguments):
    return 0


@pytest.mark.parametrize(
    ("slot", "target", "problem"),
    [
        ("strategy", Plain, "its target Plain does not derive from StrategyConfig"),
        ("strategy", verb, "does not derive from StrategyConfig"),
        ("callback", Plain, "does not derive from CallbackConfig or Callback"),
        ("strategy", Forgotten, "Forgotten is no dataclass, so share is no setting: write"),
        ("sampler", WithoutDefault, "setting share of WithoutDefault has no default"),
        ("strategy", OddType, "the settings of OddType cannot be read: TypeError: settings of"),
        ("strategy", Failing, "the settings of Failing cannot be read: ZeroDivisionError"),
        ("strategy", Abstract, "Abstract lacks refiners"),
        (
            "sampler",
            OldBuild,
            "OldBuild.build(self, views) has to take the arguments of "
            "SamplerConfig.build(self, views, seed, steps)",
        ),
        ("metric", OldMetric, "OldMetric.__call__(self, rendered, target) has to take the"),
        ("callback", OldCallback, "OldCallback.on_step(self, report) has to take the arguments"),
        ("command", Plain, "its target is no function (arguments) -> int"),
    ],
)
def test_what_breaks_the_contract_of_its_slot_is_said(slot, target, problem):
    assert problem in problem_of(slot, target)


@pytest.mark.parametrize(
    ("slot", "target"), [("sampler", Sound), ("callback", Callback), ("command", verb)]
)
def test_what_keeps_the_contract_has_no_problem(slot, target):
    assert problem_of(slot, target) == ""


def test_every_built_in_part_keeps_its_contract():
    from gsfw.plugins.registry import SLOTS, installed

    for slot in SLOTS:
        for spec in installed().slot(slot).values():
            assert problem_of(slot, spec.load()) == "", f"{slot} {spec.name}"


class OldSampler(Sampler):
    def next(self):
        return (0,)

    def peek(self):
        return (0,)

    def state_dict(self):
        return {}

    def load_state_dict(self, state):
        """It has no state."""


def test_what_was_built_for_another_version_is_named_with_package_and_remedy():
    spec = Spec("old", "", "old:Config", distribution="gsfw-old", version="0.1")
    with pytest.raises(PartError) as caught:
        check_built("sampler", spec, OldSampler())
    assert caught.value.message == (
        "sampler 'old' (gsfw-old 0.1) cannot be used: OldSampler.peek(self) has to take the "
        "arguments of Sampler.peek(self, count)."
    )
    assert "install the version of gsfw-old that was made for it" in caught.value.advice
    assert signature_problem(Sampler) == "Sampler lacks load_state_dict, next, peek, state_dict"


def test_what_builds_nothing_is_named_with_its_package():
    spec = Spec("none", "", "none:Config", distribution="gsfw-none", version="0.1")
    with pytest.raises(PartError) as caught:
        check_built("sampler", spec, None, Sampler)
    assert caught.value.message == (
        "sampler 'none' (gsfw-none 0.1) cannot be used: what it builds is NoneType, "
        "expected a Sampler."
    )


def test_a_part_that_breaks_its_contract_is_left_out_and_all_others_work():
    class Plugin(FakePlugin):
        @hookimpl
        def gsfw_strategies(self):
            return [Spec("forgotten", "", f"{__name__}:Forgotten"), self.spec("adc", Sound)]

        def spec(self, name, kind):
            return Spec(name, "", f"{__name__}:{kind.__name__}")

    class Other:
        @hookimpl
        def gsfw_strategies(self):
            return FakePlugin().gsfw_strategies()[1:]

    registry = registry_of(Plugin(), Other())
    assert list(load_all("strategy", registry)) == ["mcmc"]
    assert [(item.kind, item.name) for item in registry.broken] == [
        ("strategy", "adc"),
        ("strategy", "forgotten"),
    ]
    with pytest.raises(PartError, match=r"strategy 'forgotten' \(pkg0 1\.0\) cannot be used"):
        load("strategy", registry.find("strategy", "forgotten"))
