"""Tests of gsfw.studies.tradeoff.catalogue: the edits that a model is offered."""

from types import SimpleNamespace

import pytest
import torch

from gsfw.core.capabilities import Capabilities, Needs
from gsfw.studies.tradeoff import catalogue

pytestmark = pytest.mark.unchecked
"""The model is a stand-in."""


def test_backends_with_a_rule_of_their_own_are_not_compared():
    asked = SimpleNamespace(needs=Needs)
    settings = SimpleNamespace(config=asked)
    model = SimpleNamespace(
        restored=SimpleNamespace(composition=SimpleNamespace(settings=settings)),
        subject=SimpleNamespace(settings=asked),
        able={"surfels": Capabilities(frozenset({"cpu"}), rule="surfels", preference=9)},
        device=torch.device("cpu"),
        rasterizer="cpu",
    )
    found = catalogue._backends(model)
    assert isinstance(found, catalogue.LeftOut)
