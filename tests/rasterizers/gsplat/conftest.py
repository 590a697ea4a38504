"""The adapter over a stand-in for gsplat, which draws on the CPU."""

import sys
from types import ModuleType, SimpleNamespace

import pytest
from support import fake_gsplat

from gsfw.rasterizers.gsplat import package, rasterizer
from gsfw.rasterizers.gsplat.rasterizer import GsplatRasterizer


@pytest.fixture
def fake(monkeypatch) -> ModuleType:
    """gsplat 1.5.3 as far as anyone can tell."""
    backend = SimpleNamespace(_C=object())
    monkeypatch.setitem(sys.modules, "gsplat", fake_gsplat)
    monkeypatch.setitem(sys.modules, "gsplat.cuda", SimpleNamespace(_backend=backend))
    monkeypatch.setitem(sys.modules, "gsplat.cuda._backend", backend)
    monkeypatch.setattr(package, "version", lambda: "1.5.3")
    return fake_gsplat


@pytest.fixture
def adapter(fake, monkeypatch) -> GsplatRasterizer:
    """The adapter, on CPU tensors."""
    monkeypatch.setattr(rasterizer, "DEVICES", frozenset({"cpu"}))
    return GsplatRasterizer()
