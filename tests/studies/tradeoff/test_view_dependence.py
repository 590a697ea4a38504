"""Tradeoff of a model whose splats depend on the view: each view has its own."""

from dataclasses import replace

import pytest
import torch
from support.tradeoff_models import finished_model
from support.view_models import ByView

from gsfw.core.loop.evaluation import evaluate
from gsfw.studies.tradeoff.catalogue import catalogue
from gsfw.studies.tradeoff.measurement import Exact, Turn
from gsfw.studies.tradeoff.record import RecordStore
from gsfw.studies.tradeoff.runner import Runner

pytestmark = pytest.mark.unchecked


@pytest.fixture
def model(finished_run):
    """A finished run, whose model is fainter from some sides."""
    found = finished_model(finished_run)
    composition = found.restored.composition
    parts = replace(composition.parts, model=ByView(composition.parts.model))
    found.restored = replace(found.restored, composition=replace(composition, parts=parts))
    return found


def test_the_model_as_it_is_has_the_figures_of_gsfw_eval(model, tmp_path):
    (as_it_is,), _ = catalogue(model, ())
    runner = Runner(model, [as_it_is], RecordStore(tmp_path / "t.json", "x"))
    record = runner._record(as_it_is)
    assert record.failure == ""
    assert record.means == evaluate(model.parts, model.subject.settings).means
    assert record.relative_l2 < 1e-5
    assert record.num_gaussians == model.parts.model.num_rows


def test_timed_views_and_exact_images_have_the_splats_of_their_cameras(model):
    subject, cameras = model.subject, model.cameras
    turn = Turn.of(subject, cameras)
    for splats, camera in zip(turn.splats, cameras, strict=True):
        assert torch.equal(splats.opacities, subject.model.splats(None, camera).opacities)
    assert not torch.equal(turn.splats[0].opacities, turn.splats[1].opacities)
    assert Exact(subject, model.probes, model.registry).error(subject).relative < 1e-5


def test_splats_of_all_views_are_made_once(model):
    subject = replace(model.subject, model=model.parts.model.given)
    first, second = subject.splats_by_camera(model.cameras[:2])
    assert first is second


def test_files_of_splats_are_not_the_model(model):
    variants, _ = catalogue(model, ("sh", "format"))
    assert variants[0].command == ("export", "format=gsfw")
    assert {variant.command for variant in variants if variant.axis == "sh"} == {()}
    assert "ply" in {variant.name for variant in variants}
