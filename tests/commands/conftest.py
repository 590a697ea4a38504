"""Fixtures of the verbs' tests."""

import pytest
import torch
from support.moving_scene import SMALL_MOVING_SCENE, DriftingPlugin

from gsfw.commands.main import main
from gsfw.plugins.discovery import PluginSource
from gsfw.plugins.registry import installed


@pytest.fixture(autouse=True, scope="session")
def _one_thread():
    """Scenes of these tests are tiny: threads would only wait for one another."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def moving_run(tmp_path_factory):
    """A run of a method whose splats drift, on the built-in scene that moves."""
    discovery = installed()._discovery
    discovery.add(DriftingPlugin(), PluginSource("drifting", "tests", "1.0"))
    out = tmp_path_factory.mktemp("runs") / "moving"
    assert main(["train", "method=drifting", *SMALL_MOVING_SCENE, f"out={out}"]) == 0
    yield out
    discovery.remove("drifting")
