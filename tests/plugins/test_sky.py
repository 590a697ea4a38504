"""sky=true: what runs start from."""

from dataclasses import replace

import pytest
import torch
from support.composed_runs import composed
from support.outdoors import write_outdoors

from gsfw.core.errors import ConfigError
from gsfw.methods.gaussians3d.initialisation import SKY_OPACITY
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed


@pytest.fixture(autouse=True)
def small_images(monkeypatch):
    monkeypatch.setattr("gsfw.core.stereo.sky.PIXELS_APART", 2.0)


@pytest.fixture
def capture(tmp_path):
    return str(write_outdoors(tmp_path))


def test_a_run_starts_with_opaque_splats_of_the_sky_behind_all_others(capture):
    run = composed({"data": capture, "sky": "true", "random_points": "500"})
    model, sky = run.parts.model, run.found.sky
    assert model.num_rows == 500 + len(sky)
    assert sky.holds(model.means.values).nonzero()[:, 0].tolist() == list(
        range(500, model.num_rows)
    )
    assert torch.allclose(model.opacities()[500:], torch.tensor(SKY_OPACITY))
    # Each reaches its neighbours: the sky has no holes.
    angle = model.sizes()[500:] / sky.radius
    assert 1.0 / 40 < angle.median() < 4.0 / 40
    assert f"Starting with {len(sky):,} splats of the sky (sky=true)." in run.notes()


def test_a_restored_run_knows_its_sky_without_reading_images(capture, monkeypatch):
    first = composed({"data": capture, "sky": "true"})
    monkeypatch.setattr("gsfw.plugins.start.small_views", None)  # It is not called.
    again = compose(first.settings, installed(), restoring=True)
    assert len(again.parts.model.means.values) < first.parts.model.num_rows
    assert again.found.sky is None
    other = replace(first.settings, config=replace(first.settings.config, steps=50))
    assert compose(other, installed(), found=first.found).parts.model.num_rows == (
        first.parts.model.num_rows
    )


def test_a_capture_without_a_sky_starts_without_one(capture, monkeypatch):
    monkeypatch.setattr("gsfw.core.stereo.sky.TOLERANCE", 0.0)
    run = composed({"data": capture, "sky": "true", "random_points": "500"})
    assert run.parts.model.num_rows == 500
    assert any(
        note.startswith("sky=true: cameras agree on 0 of") and note.endswith("without a sky.")
        for note in run.notes()
    )


def test_images_with_alpha_have_no_sky(tmp_path):
    with pytest.raises(ConfigError, match=r"sky=true: the images have alpha"):
        composed({"data": str(write_outdoors(tmp_path, alpha=True)), "sky": "true"})


@pytest.mark.parametrize("method", ["4dgs", "4d-rotor", "spacetime"])
def test_moving_scenes_have_a_sky_from_views_of_all_times(tmp_path, method):
    data = str(write_outdoors(tmp_path, times=True))
    given = {"data": data, "sky": "true", "random_points": "300", "method": method}
    run = composed(given)
    assert run.parts.model.num_rows == 300 + len(run.found.sky)
