"""sky=true: what runs start from."""

from dataclasses import replace

import pytest
import torch
from support.composed_runs import composed
from support.outdoors import write_outdoors
from support.scenes import random_splats

from gsfw.core.datamanager import Split
from gsfw.core.errors import ConfigError
from gsfw.core.sky import empty_sky
from gsfw.methods.gaussians3d.initialisation import SKY_OPACITY
from gsfw.plugins.compose import compose
from gsfw.plugins.registry import installed
from gsfw.plugins.start import FILE_NOTE


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


def test_a_capture_without_a_sky_starts_without_one(tmp_path):
    data = str(write_outdoors(tmp_path, horizon=-1.0))
    run = composed({"data": data, "sky": "true", "random_points": "500"})
    assert run.parts.model.num_rows == 500
    (note,) = (note for note in run.notes() if note.startswith("sky=true: cameras agree on "))
    assert note.endswith(" directions; starting without a sky.")


def test_a_file_brings_its_own_sky(capture, tmp_path):
    (tmp_path / "one.splat").write_bytes(bytes(32))
    first = composed({"data": capture, "sky": "true"}).settings
    settings = replace(first, config=replace(first.config, init=str(tmp_path / "one.splat")))
    run = compose(settings, installed(), initial=random_splats(50))
    assert run.parts.model.num_rows == 50
    assert FILE_NOTE in run.notes()


def test_a_budget_counts_the_sky(capture):
    run = composed({"data": capture, "sky": "true", "init": "dense", "strategy.budget": "400"})
    assert len(run.found.sky) > 100
    assert run.parts.model.num_rows == 400


def test_images_with_alpha_have_no_sky(tmp_path):
    with pytest.raises(ConfigError, match=r"sky=true: the images have alpha"):
        composed({"data": str(write_outdoors(tmp_path, alpha=True)), "sky": "true"})


@pytest.mark.parametrize("method", ["4dgs", "4d-rotor", "spacetime"])
def test_moving_scenes_have_a_sky_from_views_of_all_times(tmp_path, method):
    data = str(write_outdoors(tmp_path, times=True))
    given = {"data": data, "sky": "true", "random_points": "300", "method": method}
    run = composed(given)
    assert run.parts.model.num_rows == 300 + len(run.found.sky)


@pytest.mark.parametrize("method", ["4dgs", "4d-rotor", "spacetime"])
def test_the_sky_of_a_moving_scene_is_always_there(method):
    """The built-in scene has times of points, so that other Gaussians come and go."""
    run = composed({"method": method})
    scene = run.parts.data.scene
    empty = empty_sky(scene.camera_centers, scene.extent, scene.points)
    points = empty.center + empty.radius * torch.eye(3)
    sky = replace(empty, points=points, colors=torch.ones(3, 3))
    scene, method, seed = replace(scene, sky=sky), run.parts.method, torch.Generator()
    model = method.build_model(scene, run.parts.operators, seed.manual_seed(0), None)
    method.begin(scene, run.parts.data.views(Split.TRAIN), model)
    assert model.num_rows == run.parts.model.num_rows + 3
    for time in (0.0, 1.0):
        opacities = model.splats(torch.tensor(time)).opacities
        assert torch.allclose(opacities[-3:], torch.tensor(SKY_OPACITY), atol=0.01)


def test_the_sky_does_not_widen_the_cells_of_a_field(capture):
    plain, outdoors = (
        composed({"method": "4dgs", "datamanager.width": "32", "datamanager.height": "24"})
        for _ in range(2)
    )
    scene = outdoors.parts.data.scene
    empty = empty_sky(scene.camera_centers, scene.extent, scene.points)
    points = empty.center + empty.radius * torch.eye(3).repeat(200, 1)
    sky = replace(empty, points=points, colors=torch.ones(600, 3))
    build, seed = outdoors.parts.method.build_model, torch.Generator().manual_seed(0)
    model = build(replace(scene, sky=sky), outdoors.parts.operators, seed, None)
    assert torch.equal(model.field.box.reach, plain.parts.model.field.box.reach)
