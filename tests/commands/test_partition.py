import json

import numpy as np
import pytest
from PIL import Image
from support.street import write_street

from gsfw.commands.main import main
from gsfw.partition.document import read_partition


def refused(capsys, *words: str) -> str:
    assert main(["partition", *words]) == 2
    return capsys.readouterr().err


def test_blocks_are_printed_and_drawn(tmp_path, capsys):
    street = write_street(tmp_path / "street")
    assert main(["partition", str(street), f"out={tmp_path / 'cut'}", "blocks=2x1"]) == 0
    said = capsys.readouterr().out
    assert "b0" in said
    assert "fits into memory=8.0 GB: gsfw train would do" in said
    assert np.asarray(Image.open(tmp_path / "cut" / "partition.png")).std() > 0


def test_memory_decides_the_number_of_blocks(tmp_path, capsys):
    street = write_street(tmp_path / "street", views=64, points=4000)
    words = ["partition", str(street), f"out={tmp_path / 'cut'}", "memory=296MB", "json=true"]
    assert main(words) == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document["blocks"]) > 1
    assert document["whole"]["memory_mb"] > 296


def test_a_block_that_fits_nowhere_is_named(tmp_path, capsys):
    street = write_street(tmp_path / "street")
    words = ["partition", str(street), f"out={tmp_path / 'cut'}", "memory=10MB", "blocks=2"]
    assert main(words) == 0
    said = capsys.readouterr()
    assert "In one piece the scene would need about" in said.out
    assert "block b0 needs about" in said.err
    assert "Give more blocks, or downscale=2." in said.err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("blocks=1",), "expected auto, a number from 2"),
        (("blocks=2xtwo",), "expected auto, a number from 2"),
        (("blocks=9",), "14 training views are too few for 9 blocks"),
        (("memory=lots",), "expected a size such as 8GB"),
        (("margin=-1",), "margin=-1: expected a number from 0 to 2"),
        (("share=0",), "share=0: expected a number above 0"),
        (("downscale=0",), "downscale=0: expected a finite number of at least 1"),
        ((), "the whole scene fits in one piece"),
        (("datamanager=synthetic", "blocks=2"), "cannot be cut into blocks|reads no data"),
    ],
)
def test_wishes_that_make_no_sense_are_refused(tmp_path, capsys, words, message):
    import re

    street = write_street(tmp_path / "street")
    said = refused(capsys, str(street), f"out={tmp_path / 'cut'}", *words)
    assert re.search(message, said)
    assert not (tmp_path / "cut").exists()


def test_a_folder_that_holds_something_is_refused(tmp_path, capsys):
    street = write_street(tmp_path / "street")
    assert "exists and is not empty" in refused(capsys, str(street), f"out={street}", "blocks=2")
    assert "out is missing" in refused(capsys, str(street), "blocks=2")


def test_data_without_points_is_refused(tmp_path, capsys):
    street = write_street(tmp_path / "street", points=3)
    said = refused(capsys, str(street), f"out={tmp_path / 'cut'}", "blocks=2")
    assert "has 3 points, and blocks are cut by what its views see" in said


def test_held_out_views_are_those_of_the_whole(tmp_path):
    street = write_street(tmp_path / "street")
    words = ["partition", str(street), f"out={tmp_path / 'cut'}", "blocks=2", "holdout_every=4"]
    assert main(words) == 0
    assert len(read_partition(tmp_path / "cut").held_out) == 4


@pytest.mark.parametrize(
    "cameras",
    [(-6.0, -1.0), (-6.0, 30.0)],
    ids=["no views", "no points"],
)
def test_a_block_without_views_or_points_is_refused(tmp_path, capsys, cameras):
    street = write_street(tmp_path / "street", cameras=cameras)
    said = refused(capsys, str(street), f"out={tmp_path / 'cut'}", "blocks=4")
    assert "block b3 has no training view: no view sees enough of it" in said
    assert "Give fewer blocks" in said
    assert not (tmp_path / "cut").exists()
