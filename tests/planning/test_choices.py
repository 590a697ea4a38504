"""What a planned run turns on: defaults alone, and only what its parts have."""

from dataclasses import replace

import pytest
import torch
from support.gaussians import toy_scene
from support.small_captures import ring, write_transforms
from support.small_scene import SMALL_SCENE

from gsfw.planning.choices import CHOICES, DOWNSCALES, chosen, downscale, limits
from gsfw.plugins.keys import keys
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, Settings, resolve

SCENE = toy_scene(3, camera_centers=torch.arange(180.0).view(60, 3))
METHODS = ("3dgs", "4dgs", "4d-rotor", "spacetime", "dynamic3dgs")


def settings(**values) -> Settings:
    scene = dict(item.split("=") for item in SMALL_SCENE)
    return resolve(installed(), [Layer("the test", {**scene, "device": "cpu", **values})])


def test_choices_replace_defaults_and_nothing_that_was_given():
    assert chosen(settings(method="3dgs"), 20_000.0, SCENE)["init"] == "dense"
    given = settings(method="3dgs", init="points")
    assert chosen(given, 20_000.0, SCENE) == {"resolution_schedule": "auto"}


def test_a_strategy_is_chosen_where_neither_it_nor_a_setting_of_it_has_another_source(tmp_path):
    write_transforms(tmp_path / "transforms.json", ring())

    def strategy(**values) -> str | None:
        layer = Layer("the test", {"data": str(tmp_path), "device": "cpu", **values})
        return chosen(resolve(installed(), [layer]), 2000.0, SCENE).get("strategy")

    assert strategy(method="3dgs") == "error"
    assert strategy(method="3dgs", strategy="adc") is None, "given"
    assert strategy(method="3dgs", **{"strategy.grow_gradient": "1e-4"}) is None, "one of adc's"
    assert strategy(method="3dgs", preset="high") is None, "the preset's"
    assert strategy(method="4d-rotor") is None, "the method has settings for adc"
    assert "strategy" not in chosen(settings(method="3dgs"), 2000.0, SCENE), (
        "so has the built-in scene"
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("strategy", ["adc", "mcmc"])
def test_choices_are_keys_of_every_method_and_strategy(method, strategy):
    moving = {"datamanager.moving": "true", "datamanager.times": "4"}
    run = settings(method=method, strategy=strategy, **(moving if method != "3dgs" else {}))
    known = {key.name for key in keys(run.config)}
    for choice in CHOICES:
        assert chosen(run, float(choice.updates), SCENE).keys() <= known
    assert limits(run, float(choice.updates), SCENE, 1000, 500).keys() <= known


def test_points_that_have_times_are_not_replaced_by_a_surface_of_one_time():
    run = settings(method="3dgs")
    assert chosen(run, 300.0, SCENE)["init"] == "dense"
    assert "init" not in chosen(run, 300.0, replace(SCENE, point_times=torch.zeros(3)))


def test_rows_follow_the_number_of_updates():
    run = settings(method="3dgs")
    assert "resolution_schedule" not in chosen(run, 300.0, SCENE)
    assert "resolution_schedule" in chosen(run, 3000.0, SCENE)
    assert "strategy.budget" not in chosen(run, 20_000.0, SCENE), "it takes up to half a decibel"


def test_a_limit_of_gaussians_follows_the_pixels_and_never_lies_below_the_start():
    run = settings(method="3dgs", strategy="mcmc")
    assert limits(run, 300.0, SCENE, 50_000, 12_000) == {"strategy.cap_max": 40_000}
    assert limits(run, 20_000.0, SCENE, 50_000, 12_000) == {"strategy.cap_max": 100_000}
    assert limits(run, 300.0, SCENE, 1000, 12_000) == {"strategy.cap_max": 12_000}
    given = settings(method="3dgs", strategy="mcmc", **{"strategy.cap_max": "900000"})
    assert limits(given, 300.0, SCENE, 1000, 100) == {}


def test_few_camera_positions_get_few_gaussians():
    run = settings(method="3dgs", strategy="mcmc")
    array = replace(SCENE, camera_centers=SCENE.camera_centers[:10].repeat(24, 1))
    assert limits(run, 20_000.0, array, 50_000, 12_000) == {"strategy.cap_max": 25_000}


def test_images_are_as_large_as_the_time_allows():
    def at(updates_at_full_size: float) -> float:
        return downscale((4000, 3000), [updates_at_full_size * d**1.6 for d in DOWNSCALES])

    assert at(5000.0) == 1.0
    assert at(100.0) == 6.0
    assert at(0.001) == 16.0
    assert downscale((300, 200), [1.0 for _ in DOWNSCALES]) == 1.5, "no image gets too small"
