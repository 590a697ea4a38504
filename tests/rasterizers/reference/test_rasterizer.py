"""The reference rasterizer: its settings, and repetition."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from gsfw.core.cameras import CameraModel
from gsfw.core.capabilities import Determinism, Feature, Needs
from gsfw.rasterizers import gsfw_rasterizers
from gsfw.rasterizers.reference.config import ReferenceConfig


@pytest.mark.slow
@pytest.mark.parametrize("deterministic", [False, True])
def test_repeating_an_image_of_more_than_50000_rows_gives_the_same_bits(deterministic):
    script = Path(__file__).with_name("repeat.py")
    environment = os.environ | {"PYTHONPATH": str(script.parents[2])}
    result = subprocess.run(
        [sys.executable, str(script), str(int(deterministic))],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert result.stdout == "11 compared\n"


def test_it_can_do_everything_and_is_never_preferred():
    able = ReferenceConfig().capabilities()
    assert able.devices >= {"cpu"}
    assert ("cuda" in able.devices) == torch.cuda.is_available()
    assert able.preference == 0
    assert able.determinism is Determinism.BITWISE
    everything = Needs(frozenset(CameraModel), frozenset(Feature), channels=1000)
    assert able.lacking(everything, "cpu") == []


def test_it_is_registered_and_built_from_its_config():
    (spec,) = (spec for spec in gsfw_rasterizers() if spec.name == "reference")
    config = spec.load()(chunk_mb=1.0)
    assert config.build(torch.device("cpu")).chunk_mb == 1.0
