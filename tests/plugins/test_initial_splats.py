"""Splats are found by content, in files and folders, and every verb takes them or says why not."""

import json
import os
import zipfile

import pytest
import torch
from support.plugin_files import plugin_path  # noqa: F401 - a fixture
from support.scenes import random_splats

from gsfw.commands.interface.runs import find_run
from gsfw.commands.main import main
from gsfw.core.errors import DataError
from gsfw.core.exchange import SplatFile
from gsfw.core.words import shell_argument
from gsfw.formats.ply import PlyExporter
from gsfw.plugins.exporters import format_of, make_exporter
from gsfw.plugins.initial_splats import check_initial, find_importer, importer_of
from gsfw.plugins.registry import installed

pytestmark = pytest.mark.unchecked

PLUGIN = '''
from gsfw.api import Importer, Spec, hookimpl
from gsfw.formats.ply import PlyImporter


class FolderImporter(Importer):
    """Reads the PLY in a folder with a mark."""

    @classmethod
    def recognises(cls, path):
        return (path / "mark").is_file()

    def read(self, path):
        return PlyImporter().read(path / "a.ply")


class CarelessImporter(Importer):
    """Knows files only."""

    @classmethod
    def recognises(cls, path):
        with path.open("rb") as file:
            return file.read(4) == b"mine"

    def read(self, path):
        return PlyImporter().read(path)


@hookimpl
def gsfw_importers():
    place = "folders_of_splats:"
    return [
        Spec("careless", "of a test", place + "CarelessImporter"),
        Spec("folder", "of a test", place + "FolderImporter"),
    ]
'''


@pytest.fixture
def folder(tmp_path, plugin_path):  # noqa: F811 - the fixture
    """A folder with splats, which an importer of a plugin reads."""
    (tmp_path / "folders_of_splats.py").write_text(PLUGIN)
    plugin_path(tmp_path / "folders_of_splats.py")
    made = tmp_path / "some splats"
    made.mkdir()
    (made / "mark").touch()
    PlyExporter().write(made / "a.ply", SplatFile(random_splats(9, 1, dtype=torch.float64)))
    return made


def test_a_folder_and_a_file_are_recognised_by_content(folder):
    registry = installed()
    assert importer_of(folder, registry) == "folder"
    assert importer_of(folder / "a.ply", registry) == "ply"
    (folder / "a.ply").rename(folder / "b.dat")
    assert importer_of(folder / "b.dat", registry) == "ply"
    assert importer_of(folder.parent, registry) is None
    assert importer_of(folder / "none", registry) is None
    assert registry.broken == [], "an importer that knows files only is not at fault"
    check_initial(str(folder), registry)
    assert find_run(str(folder), print, splats=True).splat_file == folder


def test_what_is_no_splats_is_refused(folder):
    with pytest.raises(DataError) as caught:
        find_importer(folder.parent, installed())
    assert str(caught.value).startswith(
        f"{folder.parent} contains no splats that can be read here."
    )
    with pytest.raises(DataError, match="there is no such file") as caught:
        find_importer(folder / "A.ply", installed())
    assert "Did you mean 'a.ply'?" in str(caught.value)
    with pytest.raises(DataError) as caught:
        check_initial("nothing", installed())
    assert "init is a splat file, or " in str(caught.value)


def test_a_folder_of_splats_is_described_rendered_and_converted(folder, tmp_path, capsys):
    assert main(["info", str(folder), "json=true"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["format"], found["num_gaussians"], found["num_dropped"]) == ("folder", 9, 0)
    out = tmp_path / "images"
    line = ["what=orbit", "frames=1", "width=32", "video=none", f"out={out}"]
    assert main(["render", str(folder), *line]) == 0
    assert main(["convert", str(folder), str(tmp_path / "b.ply"), "check=false"]) == 0
    assert main(["convert", str(folder), str(folder / "b.ply")]) == 2


@pytest.mark.parametrize(
    "command",
    [["check", "{}"], ["prepare", "{}", "out=scene"], ["train", "method=3dgs", "data={}"]],
)
def test_splats_are_no_data_set(folder, tmp_path, capsys, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    for path in (folder, folder / "a.ply"):
        assert main([word.format(path) for word in command]) == 2
        said = capsys.readouterr().err
        assert "which holds splats, and no photos with cameras.\n" in said
        assert f"gsfw view '{path}'. To train" in said
    assert not (tmp_path / "scene").exists()


@pytest.mark.parametrize("verb", ["eval", "report", "resume", "export"])
def test_a_verb_for_runs_says_what_splats_lack(folder, capsys, verb):
    for path in (folder, folder / "a.ply"):
        assert main([verb, str(path)]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"error: {path} holds splats, and is not a run: it has no photos")
        assert f"gsfw convert {shell_argument(path)} OUT" in said


@pytest.mark.slow
def test_splats_are_traded_off_against_their_own_renders(folder, tmp_path, capsys):
    out = tmp_path / "tradeoff"
    line = ["axes=sh", "views=1", "repeats=1", f"out={out}", "json=true"]
    assert main(["tradeoff", str(folder / "a.ply"), *line]) == 0
    assert "renders of the model" in capsys.readouterr().err


def test_the_folder_and_the_description_of_a_sog_stand_for_its_splats(tmp_path, capsys):
    made = make_exporter("sog", installed())
    made.write(tmp_path / "a.sog", SplatFile(random_splats(40, 1, dtype=torch.float64)))
    folder = tmp_path / "sog"
    with zipfile.ZipFile(tmp_path / "a.sog") as archive:
        archive.extractall(folder)
    for path in (folder, folder / "meta.json", tmp_path / "a.sog"):
        assert importer_of(path, installed()) == "sog"
        assert main(["convert", str(path), str(tmp_path / "b.ply"), "check=false"]) == 0
        assert "40 splats of " in capsys.readouterr().out
        check_initial(str(path), installed())
        assert find_run(str(path), print, splats=True).splat_file == path
    for out in (folder, folder / "c.ply", folder / "meta.json"):
        assert main(["convert", str(folder), str(out), "format=ply"]) == 2
        assert "would be overwritten" in capsys.readouterr().err
    same = str(folder / "meta.json")
    assert main(["convert", same, same, "format=ply"]) == 2
    assert not (folder / "c.ply").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a.sog", "a.spz", "a.compressed.ply", "a.splat", "a.glb"])
def test_training_begins_with_splats_of_any_format(tmp_path, name):
    content = SplatFile(random_splats(60, 1, dtype=torch.float64))
    form = format_of(tmp_path / name, installed())
    assert form is not None
    make_exporter(form, installed()).write(tmp_path / name, content)
    out = tmp_path / "run"
    small = ["datamanager.views=4", "datamanager.eval_views=1", "datamanager.width=32"]
    line = ["method=3dgs", f"init={tmp_path / name}", "steps=2", f"out={out}", *small]
    assert main(["train", *line, "strategy=none"]) == 0
    assert main(["export", str(out), f"out={tmp_path / 'b.ply'}"]) == 0
    assert len(find_importer(tmp_path / "b.ply", installed()).read(tmp_path / "b.ply").splats) > 40


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "a.ply")
    with pytest.raises(DataError, match="is a pipe or a device, and gsfw reads files more than"):
        importer_of(tmp_path / "a.ply", installed())
