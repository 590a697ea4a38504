"""Every completed run leaves what it required behind, and is never lost for it."""

import json
from pathlib import Path

import pytest
import torch
from support.moving_runs import MOVING
from support.states import assert_same_bits
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from gsfw.commands.main import main
from gsfw.core.errors import OutputError
from gsfw.core.loop.checkpoint_file import read_checkpoint
from gsfw.core.loop.run_folder import RunFolder
from gsfw.core.loop.trainer import Trainer
from gsfw.studies.requirements.report import RequirementsReport

SMALL = (
    "method=3dgs", "device=cpu", "datamanager.views=6", "datamanager.eval_views=2",
    "datamanager.width=32", "datamanager.height=24", "datamanager.points=150", "steps=4",
)  # fmt: skip


def document(folder) -> dict:
    return json.loads(RunFolder(Path(folder)).requirements.read_text())


def test_a_run_says_where_its_floats_went(finished_run):
    found = document(finished_run)
    summary = json.loads(RunFolder(finished_run).summary.read_text())
    count = found["num_gaussians"]
    assert count == summary["num_gaussians"]
    assert found["total_floats"] == summary["model_bytes"] / 4 == count * 59
    assert found["sh_floats"] == found["sh_floats_full"] == count * 48
    assert found["training_floats"] == {"optimizer": summary["optimizer_bytes"] // 4}
    assert found["psnr"] == pytest.approx(summary["psnr"])
    assert found["measured"]["split"] == "eval"
    assert len(found["measured"]["views"]) == 2
    groups = {group["name"]: group for group in found["groups"]}
    assert sum(group["share"] for group in groups.values()) == pytest.approx(1.0)
    assert groups["SH band 0"]["bought_db"] is None
    assert all(isinstance(groups[f"SH band {band}"]["bought_db"], float) for band in (1, 2, 3))
    assert (found["strategy"], found["method"]) == ({}, {})


def test_the_same_is_in_the_picture_in_tensorboard_and_in_the_log(finished_run):
    folder = RunFolder(finished_run)
    assert folder.requirements_plot.read_bytes().startswith(b"\x89PNG")
    events = EventAccumulator(str(folder.tensorboard))
    events.Reload()
    found = document(finished_run)
    assert events.Scalars("9_requirements/sh_floats")[0].value == found["sh_floats"]
    assert f"requirements: {found['headline']}" in folder.log.read_text()


@pytest.mark.slow
@pytest.mark.usefixtures("fine_charts")
def test_the_summary_of_a_run_has_it_and_info_shows_it(tmp_path, capsys):
    out = str(tmp_path / "run")
    assert main(["train", *SMALL, f"out={out}"]) == 0
    found = document(out)
    assert found["headline"].startswith("colour takes 48 numbers for each Gaussian; PSNR falls by")
    said = " ".join(capsys.readouterr().out.split())
    assert f" kB {found['headline']} folder {out} files report.html, splats.ply" in said
    assert ", requirements.png, metrics.json, log.txt next" in said
    assert main(["info", out, "json=true"]) == 0
    shown = json.loads(capsys.readouterr().out)["requirements"]
    assert shown == {key: found[key] for key in shown}
    assert {"headline", "sh_floats", "sh_floats_full", "total_floats"} <= shown.keys()


def test_measuring_changes_nothing_of_what_is_trained(tmp_path, monkeypatch):
    make = RequirementsReport.make
    states = []

    def watched(self):
        for measure in (lambda: None, lambda: make(self)):
            measure()
            state = self._trainer.state_dict()
            states.append(torch.utils._pytree.tree_map(_copy, state))

    monkeypatch.setattr(RequirementsReport, "make", watched)
    assert main(["train", *SMALL, "strategy=mcmc", f"out={tmp_path / 'run'}"]) == 0
    assert (tmp_path / "run" / "requirements.json").is_file()
    assert_same_bits(*states)


def _copy(leaf):
    return leaf.clone() if isinstance(leaf, torch.Tensor) else leaf


@pytest.mark.slow
@pytest.mark.usefixtures("fine_charts")
def test_a_resumed_run_reports_what_an_unbroken_one_does(tmp_path):
    for name in ("whole", "parts"):
        arguments = [*SMALL, "steps=6", "checkpoint_every=3", f"out={tmp_path / name}"]
        assert main(["train", *arguments]) == 0
    whole, parts = RunFolder(tmp_path / "whole"), RunFolder(tmp_path / "parts")
    for path in (parts.checkpoint(6), parts.summary, parts.requirements, parts.requirements_plot):
        path.unlink()
    assert main(["resume", str(parts.path)]) == 0
    first, second = document(whole.path), document(parts.path)
    for found in (first, second):
        del found["measured"]["seconds"]
    assert first == second
    assert whole.requirements_plot.read_bytes() == parts.requirements_plot.read_bytes()


def test_a_disk_that_fails_leaves_the_requirements_to_resume(tmp_path, capsys, monkeypatch):
    folder, write = RunFolder(tmp_path / "run"), RunFolder.write_json

    def fail(self, path, document):
        if path == folder.requirements:
            raise OutputError("the disk fails.", "Check it.")
        return write(self, path, document)

    with monkeypatch.context() as patched:
        patched.setattr(RunFolder, "write_json", fail)
        assert main(["train", *SMALL, f"out={folder.path}"]) == 2
    assert "error: the disk fails." in capsys.readouterr().err
    assert not folder.requirements.exists()
    assert main(["resume", str(folder.path)]) == 0
    assert folder.requirements.exists()


def test_a_failure_to_measure_loses_nothing(tmp_path, capsys, monkeypatch):
    def fail(*arguments):
        raise RuntimeError("no paper left")

    monkeypatch.setattr("gsfw.studies.requirements.report.plot", fail)
    folder = RunFolder(tmp_path / "run")
    assert main(["train", *SMALL, f"out={folder.path}"]) == 0
    said = capsys.readouterr()
    assert "warning: no report of requirements: RuntimeError: no paper left\n" in said.err
    assert "done: 3dgs on synthetic, 4 steps" in said.out
    assert "requirements.png" not in said.out
    assert folder.splats.is_file()
    assert folder.summary.is_file()
    assert read_checkpoint(folder.checkpoint(4))["step"] == 4
    assert not folder.requirements.exists()
    assert "no paper left" in folder.log.read_text()


def test_a_run_that_was_stopped_is_not_measured(tmp_path, monkeypatch):
    one_step = Trainer._one_step

    def step_and_stop(self):
        one_step(self)
        self.control.request_stop("enough")

    monkeypatch.setattr(Trainer, "_one_step", step_and_stop)
    for steps in (2, 1):  # Stopped before the end, and at it.
        out = tmp_path / str(steps)
        assert main(["train", *SMALL, f"steps={steps}", f"out={out}"]) == 0
        assert not RunFolder(out).requirements.exists()


def test_bands_that_were_not_drawn_yet_bought_nothing_and_say_why(tmp_path):
    arguments = (*SMALL, "rescale=false", "sh_degree_interval=1000", f"out={tmp_path / 'run'}")
    assert main(["train", *arguments]) == 0
    found = document(tmp_path / "run")
    group = next(group for group in found["groups"] if group["name"] == "SH band 3")
    assert group["bought_db"] == 0.0
    assert group["how"] == "Training ended before this band was rendered."
    assert "bands 1 to 3: training ended before they were rendered" in found["could_go"]


def test_without_held_out_views_it_says_so(tmp_path):
    arguments = (*SMALL, "datamanager.eval_views=0", f"out={tmp_path / 'run'}")
    assert main(["train", *arguments]) == 0
    found = document(tmp_path / "run")
    assert found["measured"]["split"] == "train"
    assert found["not_measured"] == [
        "No view is held out: PSNR is that of views the model was trained on."
    ]


@pytest.mark.slow
def test_a_rasterizer_of_another_kind_is_reported_too(tmp_path):
    arguments = (*SMALL, "rasterizer=reference", "steps=1", f"out={tmp_path / 'run'}")
    assert main(["train", *arguments]) == 0
    assert document(tmp_path / "run")["least_useful"]


@pytest.mark.slow
@pytest.mark.slow
@pytest.mark.parametrize(("method", "group"), [("spacetime", "time parameters"), ("4dgs", "grid")])
def test_moving_methods_say_what_time_took_and_bought(tmp_path, method, group):
    arguments = (*MOVING, f"method={method}", "steps=8", f"out={tmp_path / 'run'}")
    assert main(["train", *arguments]) == 0
    found = document(tmp_path / "run")
    summary = json.loads(RunFolder(tmp_path / "run").summary.read_text())
    groups = {item["name"]: item for item in found["groups"]}
    assert groups[group]["floats"] > 0
    assert found["total_floats"] == pytest.approx(summary["model_bytes"] / 4, abs=1)
    assert found["motion"]["time"] == 0.5
    if group == "time parameters":
        assert groups[group]["bought_db"] == found["motion"]["bought_db"]
        assert "at time 0.5 of 0 to 1" in groups[group]["how"]
