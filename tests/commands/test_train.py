"""Tests of gsfw.commands.train and what it shares with resume."""

import json
import re
from pathlib import Path

import pytest
from support.small_captures import ring, write_images, write_transforms

from gsfw.commands.interface import progress
from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder

SMALL = (
    "method=3dgs", "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "steps=4",
)  # fmt: skip


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    """Runs without out= go below an empty folder."""
    monkeypatch.chdir(tmp_path)


def refusal(capsys, *arguments: str) -> str:
    assert main(["train", *arguments]) == 2
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return said.err


def test_without_a_method_the_methods_are_listed_with_the_next_command(capsys):
    lines = refusal(capsys).splitlines()
    assert lines[:2] == ["error: no method is chosen.", "Methods:"]
    described = [line.split(maxsplit=1) for line in lines[2:-1]]
    assert ["3dgs", "static 3D Gaussians with spherical-harmonic colours"] in described
    assert lines[-1] == "Next: gsfw train method=3dgs (with --help: every setting)."


def test_help_without_a_method_has_examples(capsys):
    assert main(["train", "--help"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("usage: gsfw train method=NAME [key=value ...]\n\nMethods:\n")
    assert "\n\nexamples:\n  gsfw train method=3dgs\n" in said


def test_a_misspelt_method_is_named(capsys, tmp_path):
    lines = refusal(capsys, "mehtod=3dgs", "steps=30").splitlines()
    assert lines[:2] == ["error: unknown key 'mehtod'. Did you mean 'method'?", "Methods:"]
    (tmp_path / "a.yaml").write_text("methods: 3dgs")
    assert refusal(capsys, "config=a.yaml").startswith(
        "error: config file a.yaml: unknown key 'methods'. Did you mean 'method'?"
    )
    assert refusal(capsys, "steps=30").startswith("error: no method is chosen.")


def test_words_of_other_tools_are_answered_with_ours(capsys):
    assert "no method 'splatfacto'. Did you mean '3dgs'?" in refusal(capsys, "method=splatfacto")
    for key, ours in {"iterations": "steps", "lr": "optim.means_lr"}.items():
        assert f"unknown key {key!r}. Did you mean {ours!r}?" in refusal(capsys, *SMALL, f"{key}=1")


def test_words_that_are_no_pairs_are_explained(capsys, tmp_path):
    (tmp_path / "garden").mkdir()
    explained = {
        "3dgs": "Write method=3dgs.",
        "garden": "Write data=garden.",
        "json": "Write json=true, or --json.",
        "steps": "Write steps=VALUE; all keys: gsfw train --help.",
    }
    for word, advice in explained.items():
        assert refusal(capsys, word) == f"error: {word!r} is not key=value.\n{advice}\n"


def test_help_shows_every_key_with_type_default_and_sentence(capsys):
    assert main(["train", "method=3dgs", "strategy=mcmc", "steps=oops", "--help"]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == "usage: gsfw train method=3dgs [key=value ...]"
    assert "strategy=mcmc name adc, error, mcmc, none" in lines
    assert any(line.startswith("seed=42 whole number Seed of every generator;") for line in lines)
    assert {"parts", "run", "optim", "strategy mcmc", "datamanager synthetic"} <= set(lines)
    assert any(line.endswith("together: fast, default, high, paper.") for line in lines)


def test_help_says_nothing_of_the_wait_for_it(capsys, monkeypatch):
    monkeypatch.setattr(progress, "PATIENCE", 0.0)
    assert main(["train", "method=3dgs", "--help"]) == 0
    assert capsys.readouterr().err == ""


def test_help_shows_the_values_that_the_run_has_on_the_given_data(capsys, tmp_path):
    data = write_transforms(tmp_path / "transforms.json", ring()).parent
    write_images(tmp_path, ring())
    words = ["method=3dgs", f"data={data}", "preset=fast", "sh=2"]
    assert main(["config", "show", *words, "json=true"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert main(["train", *words, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"Values of a run on data={data} with the given settings" in text
    keys = [line.split()[0] for line in text.splitlines() if "=" in line and line[0] != " "]
    helped = dict(key.partition("=")[::2] for key in keys)
    for key in ("steps", "strategy.reset_every", "strategy.refine_stop", "eval_every", "sh_degree"):
        assert helped[key] == str(shown[key]["value"]), key
    assert helped["steps"] == "7000"


def test_help_on_a_wrong_line_says_that_its_values_are_others(capsys):
    assert main(["train", "method=3dgs", "data=nowhere", "--help"]) == 0
    assert (
        "Values without the given settings, which are wrong: data=nowhere: there is no such file"
        in capsys.readouterr().out
    )


def test_a_misspelt_key_a_wrong_type_and_a_missing_folder_make_no_folder(capsys, tmp_path):
    assert "Did you mean 'optim.means_lr'?" in refusal(capsys, *SMALL, "optim.mean_lr=1")
    assert "steps=abc: expected a whole number, found 'abc'." in refusal(
        capsys, *SMALL, "steps=abc"
    )
    assert "data=nowhere: there is no such file or folder." in refusal(
        capsys, *SMALL, "data=nowhere"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_resolution_schedule_that_cannot_be_is_explained(capsys):
    assert refusal(capsys, *SMALL, "resolution_schedule=coarse") == (
        "error: resolution_schedule=coarse: expected none or auto.\n"
    )
    assert refusal(capsys, *SMALL, "resolution_schedule=auto", "resolution_steps=4") == (
        "error: resolution_steps=4: expected less than steps=4, so that training ends on full-size "
        "images.\nLeave it out: it then follows from steps (not with rescale=false). Or give "
        "less.\n"
    )
    assert refusal(capsys, *SMALL, "resolution_steps=-1") == (
        "error: resolution_steps=-1: expected a number of at least 0.\n"
    )


@pytest.mark.slow
def test_dry_run_says_how_pictures_will_grow(capsys):
    sizes = ("datamanager.width=128", "datamanager.height=96", "steps=1000")
    asked = ("train", *SMALL, *sizes, "resolution_schedule=auto", "--dry-run")
    assert main([*asked]) == 0
    assert "note: Images start at 1/1.4 of their size and reach" in capsys.readouterr().out
    assert main([*asked, "steps=100"]) == 0
    assert "note: resolution_schedule=auto leaves all images at" in capsys.readouterr().out


def test_without_the_native_module_a_run_says_that_it_will_be_slow(capsys, monkeypatch):
    monkeypatch.setattr("gsfw.rasterizers.cpu.rasterizer.instruction_sets", list)
    assert main(["train", *SMALL, "device=cpu", "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert (
        "note: rasterizer cpu is faster than reference, but the native CPU module was not" in said
    )
    assert "Install both (Debian: apt install g++ python3-dev" in said


def test_dry_run_checks_everything_and_writes_nothing(capsys, tmp_path):
    assert main(["train", *SMALL, "--dry-run"]) == 0
    said = capsys.readouterr().out
    first, described, *_ = said.splitlines()
    assert first == "preparing method 3dgs on the built-in scene, device auto"
    assert described.startswith("method 3dgs, growth by adc, rasterizer ")
    assert "6 views to train on, 2 held out; 150 Gaussians to start with" in said
    assert re.search(r"expected on this machine: \d+ s, .* GB of memory, \d+ MB of disk", said)
    assert "everything fits; without --dry-run the run would go to runs/" in said
    assert list(tmp_path.iterdir()) == []


def test_a_run_goes_to_a_folder_of_its_own_and_says_what_is_next(capsys, tmp_path):
    assert main(["train", *SMALL]) == 0
    (path,) = (tmp_path / "runs").glob("*/3dgs/*")
    said = capsys.readouterr().out
    run = path.relative_to(tmp_path)
    assert "\ndone: 3dgs on synthetic, 4 steps\n" in said
    assert re.search(r"\n  PSNR +[\d.]+ dB +mean of 2 held-out views of \d+ x \d+ ", said)
    assert re.search(rf"\n  folder +{run}\n  files +report.html, splats.ply \([\d.]+ kB\), ", said)
    for following in ("tensorboard --logdir", "gsfw eval", "gsfw render"):
        assert re.search(rf"\n  (next)? +{following} {run}\n", said)
    assert "gsfw report" not in said, "it is written already"
    (export,) = re.findall(rf"\n +gsfw (export {run} out=scene.spz)\n", said)
    assert main(export.split()) == 0
    assert (tmp_path / "scene.spz").is_file()


@pytest.mark.slow
def test_of_a_moving_model_all_times_are_exported_next(capsys):
    moving = [
        *SMALL,
        "method=spacetime",
        "datamanager.moving=true",
        "datamanager.times=2",
        "report=false",
    ]
    assert main(["train", *moving, "out=moving"]) == 0
    said = capsys.readouterr().out
    assert "gsfw report moving\n" in said, "it was not written"
    (export,) = re.findall(r"\n +gsfw (export moving .*)\n", said)
    assert main(export.split()) == 0
    assert "moving splats" in capsys.readouterr().out


def test_with_json_standard_output_is_the_summary_alone(capsys, tmp_path):
    assert main(["train", *SMALL, "out=run", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["run"] == "run"
    assert document["completed"] is True
    assert {"psnr", "ssim", "num_gaussians", "train_seconds", "steps"} <= document.keys()
    assert document["steps"] == 4


@pytest.mark.slow
def test_the_saved_config_makes_the_same_run_again(capsys):
    assert main(["train", *SMALL, "strategy=mcmc", "seed=7", "out=first"]) == 0
    assert main(["train", "config=first/config.yaml", "out=second"]) == 0
    first, second = RunFolder(Path("first")), RunFolder(Path("second"))
    assert "strategy: mcmc" in second.config.read_text()
    figures = [json.loads(folder.summary.read_text())["psnr"] for folder in (first, second)]
    assert figures[0] == figures[1]


def test_an_existing_run_is_refused_before_any_work(capsys, monkeypatch):
    assert main(["train", *SMALL, "out=run"]) == 0
    capsys.readouterr()
    monkeypatch.setattr("gsfw.plugins.compose.compose", None)
    assert refusal(capsys, *SMALL, "out=run") == (
        "error: out=run: this folder holds a run already.\n"
        "Continue it: gsfw resume run, or choose another folder with out=DIR.\n"
    )


def test_a_failure_before_the_first_checkpoint_leaves_nothing(capsys, monkeypatch, tmp_path):
    def fail(self, step, state, keep=2):
        raise OSError("disk on fire")

    monkeypatch.setattr(RunFolder, "write_checkpoint", fail)
    (tmp_path / "errors").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "errors"))
    assert main(["train", *SMALL, "out=a/b/run"]) == 1
    assert "error: gsfw failed unexpectedly: OSError: disk on fire" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["errors"]


def test_a_run_elsewhere_is_the_latest(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("GSFW_STATE_DIR", str(tmp_path / "state"))
    assert main(["train", *SMALL, f"out={tmp_path / 'elsewhere'}"]) == 0
    (tmp_path / "project").mkdir()
    monkeypatch.chdir(tmp_path / "project")
    capsys.readouterr()
    assert main(["info", "latest", "json=true"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["path"] == str(tmp_path / "elsewhere")
    assert f"latest is {tmp_path / 'elsewhere'}, which was started or resumed last\n" in said.err


def test_a_dry_run_says_that_nothing_can_be_written(capsys, monkeypatch, read_only_folder):
    monkeypatch.chdir(read_only_folder)
    said = refusal(capsys, *SMALL, "--dry-run")
    assert "runs, the folder of runs without out=DIR, cannot be written: " in said
    assert "Choose another with out=DIR." in said
    said = refusal(capsys, *SMALL, "--dry-run", f"out={read_only_folder}/new")
    assert f"error: out={read_only_folder}/new cannot be written: " in said
