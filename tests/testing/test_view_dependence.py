"""The promise on view dependence, with few views."""

from types import SimpleNamespace

import pytest
from support.gaussians import gaussians
from support.scenes import front_camera
from support.view_models import ByView

from gsfw.plugins.registry import installed
from gsfw.testing import methods
from gsfw.testing.promise import BrokenPromise
from gsfw.testing.subject import Subject

(PROMISE,) = (item for item in methods.PROMISES if item.name == "view-dependence-is-declared")


def check(monkeypatch, model, cameras):
    """Check a model of a still scene with the given training views."""
    data = SimpleNamespace(
        scene=SimpleNamespace(is_dynamic=False),
        views=lambda split: SimpleNamespace(cameras=cameras),
    )
    trainer = SimpleNamespace(parts=SimpleNamespace(model=model, data=data))
    monkeypatch.setattr(methods, "trained", lambda subject: (trainer, None, None))
    registry = installed()
    PROMISE.function(Subject("method", registry.find("method", "3dgs"), registry))


def test_a_capture_of_one_view_is_checked_too(monkeypatch):
    check(monkeypatch, gaussians(4), (front_camera(),))


def test_splats_of_two_views_are_compared(monkeypatch):
    model = ByView(gaussians(4))
    model.depends_on_view = False
    with pytest.raises(BrokenPromise, match="asked for another camera"):
        check(monkeypatch, model, (front_camera(), front_camera(distance=3.0)))
