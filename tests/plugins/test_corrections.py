"""Corrections of the capture in whole runs: what was made wrong on purpose is found again."""

import math
from dataclasses import dataclass
from typing import Any

import pytest
import torch
from support.perturbed_captures import WrongCapture, wrong_motions

from gsfw.core.cameras import Cameras
from gsfw.core.capabilities import Feature
from gsfw.core.datamanager import DataManager, Split
from gsfw.core.loop.corrections import CaptureCorrections
from gsfw.core.loop.run_folder import RunFolder
from gsfw.plugins.compose import compose
from gsfw.plugins.opening import open_data
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import Layer, resolve

SCENE = {
    "method": "3dgs", "device": "cpu", "strategy": "none", "background": "white",
    "eval_every": "0", "checkpoint_every": "0", "datamanager.views": "12",
    "datamanager.width": "64", "datamanager.height": "48", "datamanager.points": "1500",
}  # fmt: skip


@dataclass(frozen=True)
class Trained:
    """A finished run on a capture that is wrong."""

    summary: dict[str, Any]
    corrections: CaptureCorrections
    data: DataManager


def settings_of(**given: str):
    return resolve(installed(), [Layer("the test", {**SCENE, **given})])


def train(folder, data: DataManager, **given: str) -> Trained:
    composition = compose(settings_of(**given), installed(), data=data)
    summary = composition.trainer(RunFolder(folder)).fit()
    parts = composition.parts
    return Trained(summary, parts.corrections, parts.data)


def pixels_apart(one: DataManager, other: DataManager) -> float:
    """How far apart two sets of training cameras see the scene's points: the mean over cameras."""
    points = one.scene.points

    def seen(camera: Cameras):
        pose = camera.world_to_camera[0]
        projected = (points @ pose[:3, :3].T + pose[:3, 3]) @ camera.intrinsics[0].T
        return projected[:, :2] / projected[:, 2:]

    pairs = zip(one.views(Split.TRAIN).cameras, other.views(Split.TRAIN).cameras, strict=True)
    return float(torch.stack([(seen(a) - seen(b)).norm(dim=1).median() for a, b in pairs]).mean())


@pytest.mark.slow
def test_poses_that_are_a_degree_and_two_percent_wrong_are_found_again(tmp_path):
    given = open_data(settings_of())
    wrong = WrongCapture(given, wrong_motions(given, degrees=1.0, extents=0.02))
    steps = {"steps": "500"}
    as_given = train(tmp_path / "given", wrong, **steps)
    refined = train(tmp_path / "refined", wrong, refine_poses="true", **steps)
    before, after = pixels_apart(given, wrong), pixels_apart(given, refined.data)
    assert before > 1
    assert after < 0.25 * before
    assert refined.summary["psnr"] > as_given.summary["psnr"] + 3
    assert 0.3 < refined.summary["pose_degrees"] < 3
    assert math.isfinite(refined.summary["pose_shift"])


@pytest.mark.slow
def test_gains_of_images_are_found_again(tmp_path):
    given = open_data(settings_of())
    gains = 0.7 + 0.6 * torch.rand(12, 3, generator=torch.Generator().manual_seed(4))
    gains = gains / gains.mean(dim=0)
    wrong = WrongCapture(given, tones=gains[:, None, None, :])
    steps = {"steps": "500"}
    as_given = train(tmp_path / "given", wrong, **steps)
    learnt = train(tmp_path / "learnt", wrong, exposure="true", **steps)
    colors = given.scene.point_colors[:500]
    matrices = learnt.corrections.exposures.matrices
    found = colors @ matrices[:, :, :3].mT + matrices[:, None, :, 3]
    wanted = colors * gains[:, None]
    missed, wrong_by = (float((other - wanted).abs().mean()) for other in (found, colors))
    assert missed < 0.3 * wrong_by
    assert learnt.summary["psnr"] > as_given.summary["psnr"] + 1
    assert 0.7 < learnt.summary["exposure_least"] < 1 < learnt.summary["exposure_most"] < 1.3


def test_nothing_is_corrected_unless_asked_for(tmp_path):
    composition = compose(settings_of(steps="2"), installed())
    parts = composition.parts
    assert parts.corrections.parameter_groups() == ()
    assert dict(parts.corrections.state_dict()) == {}
    assert {"poses", "exposures"}.isdisjoint(parts.optimizer.learning_rates(0))


def test_rates_wait_for_their_start_and_decay(tmp_path):
    given = {"steps": "3000", "optim.cooldown": "0"}
    settings = settings_of(**given, exposure="true", refine_poses="true")
    rates = compose(settings, installed()).parts.optimizer.learning_rates
    assert (rates(49)["poses"], rates(49)["exposures"]) == (0, 0)
    assert rates(50)["poses"] == pytest.approx(1e-3)
    assert rates(50)["exposures"] == pytest.approx(1e-2)
    assert rates(3000)["poses"] == pytest.approx(1e-5)
    assert rates(3000)["exposures"] == pytest.approx(1e-3)


def test_refining_poses_asks_for_a_rasterizer_with_pose_gradients():
    assert Feature.POSE_GRADIENT in settings_of(refine_poses="true").config.needs().features
    assert Feature.POSE_GRADIENT not in settings_of().config.needs().features


def test_the_protocol_says_what_became_of_held_out_views():
    settings = settings_of(steps="2", exposure="true", refine_poses="true")
    protocol = compose(settings, installed()).protocol()
    assert (
        protocol["exposure"]
        == "learnt for training images; held-out images are rendered without it"
    )
    assert protocol["poses"] == "training cameras are refined, held-out cameras stay as given"
