"""A checkpoint whose content is not that of its run is refused with a message."""

import shutil

import pytest
import torch

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder

ABSENT = object()


@pytest.fixture
def run(finished_run, tmp_path):
    shutil.copytree(finished_run, tmp_path / "run")
    return RunFolder(tmp_path / "run")


def change(run, key, value):
    path = run.latest_checkpoint()
    state = torch.load(path, weights_only=True)
    if value is ABSENT:
        del state[key]
    else:
        state[key] = value
    torch.save(state, path)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("model", ABSENT, "does not fit the run: KeyError: 'model'."),
        ("model", [1, 2], "does not fit the run: TypeError"),
        ("model", {"means": torch.zeros(3)}, "does not fit the run: "),
        ("corrections", 3, "does not fit the run: "),
        ("step", "x", "is a damaged checkpoint: its step is 'x'."),
        ("step", -1, "is a damaged checkpoint: its step is -1."),
        ("step", ABSENT, "is a damaged checkpoint: its step is None."),
    ],
)
def test_a_model_that_does_not_fit_is_not_evaluated(run, capsys, key, value, words):
    change(run, key, value)
    assert main(["eval", str(run.path)]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("optimizer", 3),
        ("optimizer", ABSENT),
        ("sampler", {"order": "x"}),
        ("refiners", [1]),
        ("generator", torch.zeros(3)),
        ("environment", ABSENT),
        ("train_seconds", ABSENT),
    ],
)
def test_a_state_that_does_not_fit_is_not_resumed(run, capsys, key, value):
    change(run, key, value)
    assert main(["resume", str(run.path), "steps=24"]) == 2
    assert "does not fit the run: " in capsys.readouterr().err
