"""Verbs draw models and trees within a budget."""

import json

import pytest
from support.scenes import random_splats

from gsfw.commands.main import main
from gsfw.core.exchange import SplatFile
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.methods.gaussians3d.model import StaticGaussians

pytestmark = pytest.mark.unchecked

CPU = ("device=cpu",)


@pytest.fixture(scope="module")
def splats(tmp_path_factory):
    path = tmp_path_factory.mktemp("splats") / "all.ply"
    PlyExporter().write(path, SplatFile(random_splats(900, 1).map(lambda tensor: tensor.double())))
    return path


@pytest.fixture(scope="module")
def tree(splats):
    path = splats.with_name("all.lod")
    assert main(["convert", str(splats), str(path), "check=false"]) == 0
    return path


def test_a_tree_is_converted_back_to_all_of_its_splats(tree, tmp_path):
    assert main(["convert", str(tree), str(tmp_path / "back.ply"), "check=false"]) == 0
    assert len(PlyImporter().read(tmp_path / "back.ply").splats) == 900


def test_a_tree_is_converted_to_a_compressed_model(tree, tmp_path):
    out = tmp_path / "all.gsfw"
    words = ["convert", str(tree), str(out), "format.precision=compressed"]
    assert main(words) == 0
    assert out.is_file()


def test_a_tree_has_no_variants(tree, capsys):
    assert main(["tradeoff", str(tree)]) == 2
    said = capsys.readouterr().err
    assert "tradeoff compares variants of one set of splats, and views draw cuts of a tree." in said
    assert f"Convert it first: gsfw convert {tree} splats.ply" in said


@pytest.mark.parametrize("given", [("budget=50",), ("detail=9",), ()])
def test_a_tree_is_rendered(tree, tmp_path, given):
    words = ["render", str(tree), "what=orbit", "frames=1", "width=32", "video=none", *CPU, *given]
    assert main([*words, f"out={tmp_path}"]) == 0
    assert (tmp_path / "orbit" / "0000.png").is_file()


def test_another_budget_renders_again(splats, tmp_path):
    words = ["render", str(splats), "what=orbit", "frames=1", "width=32", "video=none", *CPU]
    images = []
    for budget in ("budget=5", "budget=600"):
        assert main([*words, budget, f"out={tmp_path}"]) == 0
        images.append((tmp_path / "orbit" / "0000.png").read_bytes())
    assert images[0] != images[1]


def test_a_budget_that_does_not_fit_into_memory_says_what_it_needs(tree, tmp_path, capsys):
    words = ["render", str(tree), "what=orbit", "budget=800", "memory=8MB", f"out={tmp_path}", *CPU]
    assert main(words) == 2
    assert "Give memory=9MB, or a smaller budget." in capsys.readouterr().err


@pytest.mark.parametrize(
    "given", ["budget=many", "budget=0", "detail=-1", "memory=lots", "memory=0MB"]
)
def test_limits_that_are_no_numbers_are_refused(tree, capsys, given):
    assert main(["render", str(tree), given]) == 2
    assert given.partition("=")[0] in capsys.readouterr().err


def test_a_model_whose_splats_depend_on_the_view_is_refused(finished_run, capsys, monkeypatch):
    monkeypatch.setattr(StaticGaussians, "depends_on_view", True)
    assert main(["eval", str(finished_run), "budget=50"]) == 2
    said = capsys.readouterr().err
    assert "one set of splats, and those of this model depend on the view." in said
    assert "Leave budget and detail out." in said


def test_info_tells_a_tree(tree, capsys):
    assert main(["info", str(tree), "json=true"]) == 0
    assert json.loads(capsys.readouterr().out)["num_gaussians"] == 900


def test_splats_are_converted_to_a_folder_for_browsers(splats, tmp_path, capsys):
    out = tmp_path / "town"
    words = ["convert", str(splats), str(out), "format=streamed-sog", "format.num_levels=2"]
    assert main([*words, "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["num_gaussians"] == 900
    assert document["psnr"] > 25  # Eight random colours share a vector.
    assert json.loads((out / "lod-meta.json").read_text())["counts"] == [900, 450]
    assert main(["info", str(out), "json=true"]) == 0
    assert json.loads(capsys.readouterr().out)["num_gaussians"] == 900
    (out / "notes.txt").write_text("mine")
    assert main(words) == 2
    assert capsys.readouterr().err == (
        f"error: {out} has files of other kinds, such as notes.txt: a streamed SOG is a folder of "
        "its own.\nChoose another place for OUT: a new or an empty folder.\n"
    )


def test_a_run_is_exported_for_browsers_at_one_time(finished_run, tmp_path, capsys):
    out = tmp_path / "town"
    words = ["export", str(finished_run), "format=streamed-sog", f"out={out}"]
    assert main([*words, "times=3"]) == 2
    assert capsys.readouterr().err == (
        "error: format=streamed-sog is written at one time: leave out times.\n"
        "Choose the time: time=0.5\n"
    )
    assert main(words) == 0
    assert (out / "lod-meta.json").exists()
