"""A model that moves is written as numbered files, with a list that says when each of them is."""

import json
from itertools import pairwise

import pytest
from support.drifting_run import drifting_run

from gsfw.commands.main import main
from gsfw.formats.ply import PlyExporter, PlyImporter
from gsfw.plugins.run_source import RunSource

MOVING = (
    "datamanager.views=6", "datamanager.eval_views=2", "datamanager.width=32",
    "datamanager.height=24", "datamanager.points=150", "datamanager.moving=true",
    "datamanager.times=4", "steps=3",
)  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of a method whose splats drift by 0.3 to the right."""
    with drifting_run(tmp_path_factory.mktemp("runs") / "moving", *MOVING) as out:
        yield out


def listed(folder):
    return json.loads((folder / "times.json").read_text())["files"]


@pytest.mark.slow
def test_times_are_even_from_first_to_last(run, tmp_path, capsys):
    assert main(["export", str(run), "times=5", f"out={tmp_path}", "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    names = [f"splats_{index:04d}.ply" for index in range(5)]
    assert document["written"] == [str(tmp_path / name) for name in names]
    assert document["index"] == str(tmp_path / "times.json")
    assert document["bytes"] == sum((tmp_path / name).stat().st_size for name in names)
    assert [entry["file"] for entry in listed(tmp_path)] == names
    assert [entry["time"] for entry in listed(tmp_path)] == [0, 0.25, 0.5, 0.75, 1]
    means = [PlyImporter().read(tmp_path / name).splats.means for name in names]
    steps = [float((after - before).norm(dim=1).mean()) for before, after in pairwise(means)]
    assert all(step == pytest.approx(steps[0], rel=1e-3) for step in steps)
    assert steps[0] > 0.01


@pytest.mark.slow
def test_all_are_the_times_of_the_data_and_its_own_unit_is_kept(run, tmp_path):
    assert main(["export", str(run), "times=all", f"out={tmp_path}"]) == 0
    times = [entry["time"] for entry in listed(tmp_path)]
    assert times == pytest.approx([0, 1 / 3, 2 / 3, 1], abs=1e-6)
    assert [entry["data_time"] for entry in listed(tmp_path)] == pytest.approx(times)


def test_a_shorter_sequence_takes_the_place_of_a_longer_one_and_nothing_else(run, tmp_path):
    assert main(["export", str(run), "times=4", f"out={tmp_path}"]) == 0
    (tmp_path / "splats_0099.ply").write_text("of somebody else")
    (tmp_path / "notes.txt").write_text("of somebody else")
    assert main(["export", str(run), "times=2", f"out={tmp_path}"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "notes.txt", "splats_0000.ply", "splats_0001.ply", "splats_0099.ply", "times.json",
    ]  # fmt: skip


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"files": 3}', '{"files": [{"file": "../splats_0.ply"}, {"file": 3}]}']
)
def test_a_strange_list_of_an_earlier_sequence_does_no_harm(run, tmp_path, text):
    folder = tmp_path / "sequence"
    folder.mkdir()
    (tmp_path / "splats_0.ply").write_text("not in the folder")
    (folder / "times.json").write_text(text)
    assert main(["export", str(run), "times=2", f"out={folder}"]) == 0
    assert len(listed(folder)) == 2
    assert (tmp_path / "splats_0.ply").exists()


def test_a_sequence_that_is_not_finished_has_no_list(run, tmp_path, monkeypatch):
    assert main(["export", str(run), "times=2", f"out={tmp_path}"]) == 0
    write, written = PlyExporter.write, []

    def fail_second(self, path, content):
        written.append(path)
        if len(written) == 2:
            raise KeyboardInterrupt
        write(self, path, content)

    monkeypatch.setattr(PlyExporter, "write", fail_second)
    assert main(["export", str(run), "times=3", f"out={tmp_path}"]) == 130
    assert not (tmp_path / "times.json").exists()
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_place_that_cannot_be_written_to_is_one_message(run, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main(["export", str(run), "times=2", f"out={tmp_path / 'file'}"]) == 2
    assert "cannot be written" in capsys.readouterr().err


def test_a_static_method_on_data_that_moves_is_refused(tmp_path, capsys):
    out = tmp_path / "blurred"
    assert main(["train", "method=3dgs", "ignore_time=true", *MOVING, f"out={out}"]) == 0
    capsys.readouterr()
    assert main(["export", str(out), "times=3"]) == 2
    assert capsys.readouterr().err == (
        "error: times=3: method 3dgs is static, so all files would be the same.\n"
        "Leave times out for one file.\n"
    )


def test_a_sequence_is_no_run_and_the_message_says_what_opens(run, tmp_path, capsys):
    assert main(["export", str(run), "times=2", f"out={tmp_path}"]) == 0
    capsys.readouterr()
    assert main(["render", str(tmp_path)]) == 2
    assert capsys.readouterr().err == (
        f"error: {tmp_path} is a sequence of 2 splat files, one for each time.\n"
        f"Give one of them, such as {tmp_path / 'splats_0000.ply'}; or, for all times, the run "
        "that it was exported from, or its model file (gsfw export RUN format=gsfw).\n"
    )


def test_a_sequence_may_be_of_any_format_of_splats(run, tmp_path, monkeypatch):
    monkeypatch.setattr(PlyExporter, "suffix", ".two.ply")
    assert main(["export", str(run), "format=ply", "times=3", f"out={tmp_path}"]) == 0
    assert main(["export", str(run), "format=ply", "times=2", f"out={tmp_path}"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "splats_0000.two.ply", "splats_0001.two.ply", "times.json",
    ]  # fmt: skip


def test_a_format_of_all_times_makes_no_sequence(run, tmp_path, capsys):
    out = tmp_path / "sequence"
    assert main(["export", str(run), "format=splatv", "times=2", f"out={out}"]) == 2
    assert "holds splats at all times: leave out time and times" in capsys.readouterr().err
    assert not out.exists()


def test_a_file_in_place_of_the_folder_is_refused(capsys):
    assert main(["export", "run", "times=3", "out=scene.spz"]) == 2
    assert capsys.readouterr().err == (
        "error: out=scene.spz: times=3 writes a folder of files.\n"
        "Give a folder, and the format of its files: out=scene format=spz\n"
    )


@pytest.mark.parametrize("words", ["times=2", "format=tracks"])
def test_sequences_and_tracks_warn_of_splats_that_depend_on_the_view(
    run, tmp_path, capsys, monkeypatch, words
):
    monkeypatch.setattr(RunSource, "view_notes", lambda self: ["as without a view"])
    assert main(["export", str(run), words, f"out={tmp_path / 'out'}", "json=true"]) == 0
    said = capsys.readouterr()
    assert "as without a view" in said.err
    assert json.loads(said.out)["notes"] == ["as without a view"]
