"""Tests of gsfw.plugins.loading: callbacks and metrics of a run."""

import math
from dataclasses import dataclass

import pytest
import torch
from support.fake_parts import FakePlugin, registry_of

from gsfw.core.callback import Callback
from gsfw.core.config import CallbackConfig
from gsfw.core.errors import ConfigError, EndedBySignal
from gsfw.core.metrics import Metric
from gsfw.core.operators import Operators
from gsfw.core.ranges import number
from gsfw.plugins.loading import load, make_callbacks, make_metrics
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve
from gsfw.plugins.specs import Spec, hookimpl


class Bare(Callback):
    pass


class Beeping(Callback):
    def __init__(self, volume: float) -> None:
        self.volume = volume


@dataclass
class Beep(CallbackConfig):
    volume: float = number(0.5, at_least=0, at_most=1)
    """How loud."""

    def build(self):
        return Beeping(self.volume)


@dataclass
class Unbuildable(CallbackConfig):
    def build(self):
        raise ConnectionError("no network")


class Moody(Metric):
    def __call__(self, rendered, target, valid):
        if valid is not None:
            raise OSError("no weights")
        return torch.tensor(0.5)


class Unmakeable(Metric):
    def __init__(self, operators):
        raise OSError("no weights")

    def __call__(self, rendered, target, valid):
        raise NotImplementedError


class Plugin(FakePlugin):
    @hookimpl
    def gsfw_callbacks(self):
        kinds = {"my-beep": Beep, "bare": Bare, "no": Unbuildable, "class": Bare}
        return [Spec(name, "", f"{__name__}:{kind.__name__}") for name, kind in kinds.items()]

    @hookimpl
    def gsfw_metrics(self):
        return [Spec(kind.__name__, "", f"{__name__}:{kind.__name__}")
                for kind in (Moody, Unmakeable)]  # fmt: skip


def settings(registry, *layers: Layer, **typed: str):
    return resolve(registry, [*layers, Layer(COMMAND_LINE, {"method": "demo", **typed})])


def test_every_callback_has_settings_and_is_on():
    registry = registry_of(Plugin())
    found = settings(registry, **{"callbacks.my_beep.volume": "0.25"})
    values = {key: value for key, value in found.flat().items() if key.startswith("callbacks.")}
    assert values == {
        "callbacks.bare.enabled": True,
        "callbacks.callback_class.enabled": True,
        "callbacks.my_beep.enabled": True,
        "callbacks.my_beep.volume": 0.25,
        "callbacks.no.enabled": True,
    }
    bare, other, beep = make_callbacks(found.config.callbacks, registry)
    assert isinstance(bare, Bare)
    assert isinstance(other, Bare)
    assert beep.volume == 0.25
    assert beep.origin == "callback 'my-beep' (pkg0 1.0)"
    assert [(item.name, item.reason) for item in registry.broken] == [
        ("no", "it failed with ConnectionError: no network")
    ]


def test_a_callback_can_be_switched_off():
    registry = registry_of(Plugin())
    off = {f"callbacks.{name}.enabled": "false" for name in ("bare", "no", "callback_class")}
    (only,) = make_callbacks(settings(registry, **off).config.callbacks, registry)
    assert isinstance(only, Beeping)
    assert registry.broken == []


def test_wrong_settings_of_callbacks_are_refused():
    registry = registry_of(Plugin())
    with pytest.raises(ConfigError, match=r"Did you mean 'callbacks\.my_beep\.volume'\?"):
        settings(registry, **{"callbacks.my_beep.volum": "1"})
    with pytest.raises(ConfigError, match=r"unknown key 'callbacks\.wandb\.enabled'"):
        settings(registry, **{"callbacks.wandb.enabled": "false"})
    loud = settings(registry, **{"callbacks.my_beep.volume": "2"})
    with pytest.raises(ConfigError) as caught:
        loud.config.check()
    assert str(caught.value) == "callbacks.my_beep.volume=2: expected a number from 0 to 1."


def test_a_run_opens_without_a_callback_that_it_had():
    saved = Layer("config file run.yaml", {"callbacks.wandb.enabled": True, "seed": 3})
    assert settings(registry_of(Plugin()), saved).config.seed == 3
    missing = Layer("config file run.yaml", {"callbacks.my_beep.pitch": 3})
    with pytest.raises(ConfigError, match=r"unknown key 'callbacks\.my_beep\.pitch'"):
        settings(registry_of(Plugin()), missing)


def test_usual_metrics_stand_before_others():
    assert list(make_metrics(installed(), Operators()))[:2] == ["psnr", "ssim"]


def test_a_metric_that_fails_is_nan_and_logged_once(caplog):
    registry = registry_of(Plugin())
    metrics = make_metrics(registry, Operators())
    assert list(metrics) == ["Moody"]
    assert [item.name for item in registry.broken] == ["Unmakeable"]
    image, valid = torch.zeros(4, 4, 3), torch.ones(4, 4, 1, dtype=torch.bool)
    figures = [metrics["Moody"](image, image, mask) for mask in (None, valid, valid, None)]
    assert figures[::3] == [0.5, 0.5]
    assert all(math.isnan(figure) for figure in figures[1:3])
    assert [record.getMessage() for record in caplog.records] == [
        "metric 'Moody' (pkg0 1.0) failed; its figures are NaN: OSError: no weights"
    ]


def test_a_signal_during_an_import_is_not_an_error_of_the_part(monkeypatch):
    def ended(spec: Spec) -> None:
        raise EndedBySignal(143)

    monkeypatch.setattr(Spec, "load", ended)
    with pytest.raises(EndedBySignal) as caught:
        load("method", Spec("3dgs", "", "nowhere:Method"))
    assert caught.value.code == 143
