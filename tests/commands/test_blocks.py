import json

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
        ("jobs=-1", "expected jobs"),
        ("stepss=4", "stepss"),
        ("method=4dgs", "moves, and blocks are merged at rest"),
    ],
)
def test_settings_that_make_no_sense_are_refused(tmp_path, capsys, word, message):
    assert main(["blocks", str(cut(tmp_path)), word]) == 2
    assert message in capsys.readouterr().err


def test_a_folder_that_is_no_partition_is_refused(tmp_path, capsys):
    assert main(["blocks", str(tmp_path)]) == 2
    assert "is no partition" in capsys.readouterr().err


@pytest.mark.slow
def test_blocks_far_from_the_origin_are_trained_merged_and_drawn(tmp_path, capsys):
    folder = cut(tmp_path, origin=(5e6, 4.2e6, 100.0))
    assert main(["blocks", str(folder), *SHORT]) == 0
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
    capsys.readouterr()
    words = ["eval", str(folder / "merged.gsfw"), f"data={folder}", "json=true"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["num_gaussians"] == len(merged)


@pytest.mark.slow
def test_finished_blocks_are_kept_and_other_settings_refused(tmp_path, capsys):
    folder = cut(tmp_path)
    assert main(["blocks", str(folder), *SHORT]) == 0
    before = {
        path: path.stat().st_mtime_ns for path in sorted(folder.glob("blocks/*/metrics.json"))
    }
    assert len(before) == 2
    assert main(["blocks", str(folder), *SHORT]) == 0
    assert "2 blocks are trained, 0 to train" in capsys.readouterr().out
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert main(["blocks", str(folder), *SHORT, "sh_degree=1"]) == 2
    said = capsys.readouterr().err
    assert "begun with sh_degree=its default, and now it is 1" in said
    assert "again=true" in said
