"""A checkpoint whose content is not that of its run is refused with a message."""

import shutil

import pytest
import torch

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder
from gsfw.samplers.uniform import UniformSampler

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
        ("model", [1, 2], "StaticGaussians cannot take its state: TypeError"),
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


def test_a_plugin_part_that_reads_its_state_wrongly_is_named_with_its_package(
    run, capsys, monkeypatch
):
    def load_state_dict(self, state):
        state["counts"]

    monkeypatch.setattr(UniformSampler, "load_state_dict", load_state_dict)
    monkeypatch.setattr(UniformSampler, "__module__", "gsfw_dots.sampler")
    assert main(["resume", str(run.path), "steps=24"]) == 2
    said = capsys.readouterr().err
    assert "run: UniformSampler of gsfw_dots cannot take its state: KeyError: 'counts'." in said
    assert "It is damaged, or of another run;" in said
    assert "Or gsfw_dots has changed since: the run's config.yaml names the version" in said


def test_a_module_that_a_model_has_got_since_is_named(run, capsys):
    state = torch.load(run.latest_checkpoint(), weights_only=True)["model"]
    state.popitem()
    change(run, "model", state)
    assert main(["eval", str(run.path)]) == 2
    said = capsys.readouterr().err
    assert "cannot take its state: RuntimeError: " in said
    assert "has changed since" not in said, "it is no plugin's"


def test_a_model_without_the_rest_of_its_state_is_evaluated_and_not_resumed(run, capsys):
    state = torch.load(run.latest_checkpoint(), weights_only=True)
    model = {key: state[key] for key in ("model", "corrections", "environment")}
    path = run.write_model(state["step"] - 1, model)
    assert main(["eval", str(path)]) == 0
    assert main(["resume", str(path)]) == 2
    assert capsys.readouterr().err.endswith(
        f"error: {path} has the model alone: no checkpoint could hold the state of its run, and "
        "training cannot continue from it.\n"
        f"Continue from the latest checkpoint: gsfw resume {run.path}\n"
    )
