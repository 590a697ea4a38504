"""Tests of gsfw.plugins.open_rasterizer: backends for programs without a run."""

from dataclasses import dataclass, replace

import pytest
import torch

from gsfw.api import Spec, hookimpl
from gsfw.plugins import open_rasterizer as module
from gsfw.plugins.open_rasterizer import open_rasterizer
from gsfw.rasterizers.reference.config import ReferenceConfig
from gsfw.testing.subject import registry_with


@dataclass
class Preferred(ReferenceConfig):
    """The reference, preferred to all others; ``rule`` as the test says."""

    rule = "splatting"

    def capabilities(self):
        return replace(super().capabilities(), rule=self.rule, preference=999)


class Plugin:
    """Registers it."""

    @hookimpl
    def gsfw_rasterizers(self):
        return [Spec("preferred", "", f"{__name__}:Preferred")]


@pytest.fixture
def opened(monkeypatch):
    """Names of what was opened, in registries with the plugin or without."""

    def name_of(name, is_installed=True):
        registry = registry_with(Plugin() if is_installed else None)
        monkeypatch.setattr(module, "installed", lambda: registry)
        names = []
        load = module.load
        with monkeypatch.context() as patch:
            patch.setattr(
                module, "load", lambda slot, spec: (names.append(spec.name), load(slot, spec))[1]
            )
            open_rasterizer(name, torch.device("cpu"))
        return names[-1]

    return name_of


def test_a_backend_with_a_rule_of_its_own_is_opened_only_by_its_name(opened, monkeypatch):
    monkeypatch.setattr(Preferred, "rule", "surfels")
    assert opened("auto") != "preferred"
    assert opened("preferred") == "preferred"


def test_the_choice_is_that_of_the_present_registry(opened):
    assert opened("auto") == "preferred"
    assert opened("auto", is_installed=False) != "preferred"
