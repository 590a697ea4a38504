"""Appearances take up what differs between photos, and are in checkpoints."""

import json
import subprocess
import sys

import torch
from gsfw_appearance.network import Appearance

from gsfw.api import open_run
from gsfw.testing import conformance

test_conforms = conformance("plugin", "gsfw-appearance")

SCENE = (
    *("datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=48"),
    *("datamanager.height=36", "datamanager.points=400", "device=cpu", "report=false"),
)


def gsfw(*arguments):
    command = [sys.executable, "-m", "gsfw", *arguments, "json=true"]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def test_factors_are_one_at_the_start_and_differ_between_images_later():
    network = Appearance(3, 4, 8, torch.Generator().manual_seed(0))
    colors = torch.rand(2, 20, 30, 3)
    assert torch.equal(network.log_factors(colors, (0, 2)), torch.zeros(2, 20, 30, 3))
    optimizer = torch.optim.Adam(network.parameters(), 0.02)
    for _ in range(150):
        optimizer.zero_grad()
        first, second = network.log_factors(colors, (0, 2)).mean(dim=(1, 2, 3))
        ((first - 0.5).square() + (second + 0.5).square()).backward()
        optimizer.step()
    assert float(first.detach()) > 0.3
    assert float(second.detach()) < -0.3


def test_a_run_learns_and_keeps_its_appearances_in_checkpoints(tmp_path):
    out = tmp_path / "run"
    command = ("train", "method=3dgs-appearance", *SCENE, "rescale=false", f"out={out}")
    summary = gsfw(*command, "steps=80", "appearance_start=20")
    assert summary["psnr_fitted"] > 15
    model = open_run(out).model
    assert len(model.appearance.embeddings) == 6
    assert float(model.appearance.fine.weight.detach().abs().max()) > 0
