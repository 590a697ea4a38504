import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import torch
from support.street import write_street

from gsfw.commands.main import main
from gsfw.core.loop.run_folder import RunFolder
from gsfw.formats.model_file import read_model_file
from gsfw.formats.ply import PlyImporter
from gsfw.partition.document import read_partition
from gsfw.partition.merging import own_rows, run_splats
from gsfw.plugins.registry import installed
from gsfw.plugins.restore import restore

SHORT = ("steps=6", "coarse.steps=4", "coarse.points=100", "report=false")


def cut(folder, **street):
    write_street(folder / "street", **street)
    words = ["partition", str(folder / "street"), f"out={folder / 'cut'}", "blocks=2"]
    assert main(words) == 0
    return folder / "cut"


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("data=elsewhere", "data is decided by the partition"),
        ("datamanager.points=4", "datamanager.points is decided by the partition"),
        ("jobs=-1", "jobs=-1: expected a number of at least 0."),
        ("stepss=4", "stepss"),
        ("method=4dgs", "is for moving scenes, and blocks are merged as static models"),
    ],
)
def test_settings_that_make_no_sense_are_refused(tmp_path, capsys, word, message):
    assert main(["blocks", str(cut(tmp_path)), word]) == 2
    assert message in capsys.readouterr().err


def test_a_folder_that_is_no_partition_is_refused(tmp_path, capsys):
    assert main(["blocks", str(tmp_path)]) == 2
    assert "is no partition" in capsys.readouterr().err


@pytest.fixture(scope="module")
def far_away(tmp_path_factory):
    """Trained and merged blocks, far from the origin."""
    folder = cut(tmp_path_factory.mktemp("far_away"), origin=(5e6, 4.2e6, 100.0))
    assert main(["blocks", str(folder), *SHORT]) == 0
    return folder


@pytest.mark.slow
def test_blocks_far_from_the_origin_are_trained_merged_and_drawn(far_away, capsys):
    folder = far_away
    partition, registry = read_partition(folder), installed()
    merged = PlyImporter().read(folder / "merged.ply").splats
    parts = [
        own_rows(
            run_splats(restore(RunFolder(folder / "blocks" / block.name), registry)),
            partition,
            block,
        ).splats.means
        for block in partition.blocks
    ]
    assert torch.equal(merged.means, torch.cat(parts))  # To the last bit of float64.
    model = read_model_file(folder / "merged.gsfw")
    assert model.rows == len(merged)
    means = model.state["means.values"]
    assert (model.scene.world_from_scene.apply(means.double()) - merged.means).abs().max() < 1e-5
    capsys.readouterr()
    words = ["eval", str(folder / "merged.gsfw"), f"data={folder}", "json=true"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["num_gaussians"] == len(merged)


@pytest.mark.slow
def test_finished_blocks_are_kept_and_other_settings_refused(far_away, capsys):
    folder = far_away
    before = {
        path: path.stat().st_mtime_ns for path in sorted(folder.glob("blocks/*/metrics.json"))
    }
    assert len(before) == 2
    assert main(["blocks", str(folder), *SHORT]) == 0
    assert "blocks: 2 trained, 0 to train" in capsys.readouterr().out
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert main(["blocks", str(folder), *SHORT, "sh_degree=1"]) == 2
    said = capsys.readouterr().err
    assert "begun with sh_degree=its default, and now it is 1" in said
    assert "again=true" in said


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="finds the processes in /proc")
def test_killed_and_interrupted_blocks_go_on_and_finished_ones_stay(tmp_path, capsys):
    folder = cut(tmp_path)
    words = [*SHORT[1:], "steps=400", "checkpoint_every=20", "eval_every=0"]
    second = RunFolder(folder / "blocks" / "b1")
    process = started(folder, words, second.checkpoint(20))
    kill_trainer(process)
    said, complained = process.communicate(timeout=60)
    assert process.returncode == 1, said + complained
    assert "block b1 failed: the run was ended from outside by SIGKILL." in complained
    assert "The system may have run out of memory" in complained
    assert "not merged: block b1 failed; the same command tries again." in said
    done = RunFolder(folder / "blocks" / "b0").summary.stat().st_mtime_ns
    reached = second.latest_checkpoint()

    process = started(folder, words, next_checkpoint(second))
    process.send_signal(signal.SIGINT)
    said, complained = process.communicate(timeout=60)
    assert process.returncode == 130, said + complained
    assert "blocks: 1 trained, 1 to train" in said
    assert "block b1: stopped; it continues from its checkpoint" in said
    assert second.latest_checkpoint() > reached

    capsys.readouterr()
    assert main(["blocks", str(folder), *words]) == 0
    assert "block b1: trained in" in capsys.readouterr().out
    steps = [json.loads(line)["step"] for line in second.metrics_log.read_text().splitlines()]
    assert steps == sorted(steps), "no step was made again"
    assert RunFolder(folder / "blocks" / "b0").summary.stat().st_mtime_ns == done
    assert (folder / "merged.gsfw").exists()


def started(folder, words, file):
    """A process of gsfw blocks, once a file is there."""
    process = subprocess.Popen(
        [sys.executable, "-m", "gsfw", "blocks", str(folder), *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    deadline = time.monotonic() + 120
    while not file.exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert file.exists()
    return process


def kill_trainer(process):
    """End the run that gsfw blocks has started as the system does where memory is full."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    for child in map(int, children):
        os.kill(child, signal.SIGKILL)


def next_checkpoint(folder):
    """The checkpoint after the next one."""
    step = int(folder.latest_checkpoint().stem.split("_")[1])
    return folder.checkpoint(step + 40)
