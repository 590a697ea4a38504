"""Fixtures of the verbs' tests."""

import pytest
import torch
from support.drifting_run import drifting_run
from support.moving_scene import SMALL_MOVING_SCENE
from support.plugin_files import plugin_path  # noqa: F401 - a fixture


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
    with drifting_run(tmp_path_factory.mktemp("runs") / "moving", *SMALL_MOVING_SCENE) as out:
        yield out


@pytest.fixture
def empty_folder(tmp_path, monkeypatch):
    """The present folder is empty, and nobody answers questions."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
