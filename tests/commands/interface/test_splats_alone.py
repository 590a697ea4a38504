"""Finished runs whose data set is gone: their splats.ply serves what needs no photos."""

import json
import shutil

import pytest

from gsfw.commands.interface.runs import find_run
from gsfw.commands.interface.splats_alone import or_splats_alone
from gsfw.commands.main import main
from gsfw.commands.view import _find
from gsfw.core.loop.run_folder import RunFolder


class Warned:
    """A console that keeps what it is told."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self.say = self.warn = self.said.append


@pytest.fixture
def run(finished_run, tmp_path):
    """A finished run on photos that were deleted since."""
    run = shutil.copytree(finished_run, tmp_path / "run")
    config = run / "config.yaml"
    config.write_text(config.read_text().replace("data: ''", "data: /nowhere/capture"))
    return run


def test_splats_are_exported_edited_and_rendered_without_the_photos(run, tmp_path, capsys):
    out = tmp_path / "small.splat"
    assert main(["export", str(run), f"out={out}", "json=true"]) == 0
    said = capsys.readouterr()
    assert said.err.splitlines()[0] == (
        f"warning: {run} was trained on /nowhere/capture, which is not there any more. "
        f"{run}/splats.ply takes its place, without photos, with made-up cameras around it. "
        "If the data set is somewhere else: data=PATH."
    )
    document = json.loads(said.out)
    assert document["num_gaussians"] > 0
    assert document["step"] is None, "a file of splats says nothing of steps"
    assert out.stat().st_size == 32 * document["num_gaussians"]
    edited = tmp_path / "edited.ply"
    assert main(["edit", str(run), "scale=2", f"out={edited}"]) == 0
    assert edited.is_file()
    frames = tmp_path / "frames"
    given = ("what=orbit", "frames=1", "width=16", "video=none", f"out={frames}")
    assert main(["render", str(run), *given]) == 0
    assert len(list(frames.glob("orbit/*.png"))) == 1
    assert capsys.readouterr().err.count("takes its place") == 2


def test_the_loss_of_view_dependence_is_told(run):
    folder, warned = RunFolder(run), Warned()
    figures = json.loads(folder.summary.read_text())
    assert not {"depends_on_view", "decodes_colors"} & figures.keys()
    noted = {"depends_on_view": True, "decodes_colors": True}
    folder.summary.write_text(json.dumps(figures | noted))
    _find(str(run), "", warned)
    assert (
        "around it. It may look different: the splats of the model depend on the view, and those "
        "of the file do not. It may look different: the model changes colours after rendering, "
        "which the file does not hold. If the data set"
    ) in warned.said[0]


def test_the_viewer_opens_the_splats(run):
    warned = Warned()
    assert _find(str(run), "", warned).splat_file == run / "splats.ply"
    assert len(warned.said) == 1
    assert _find(str(run), "/other/capture", warned).splat_file is None


@pytest.mark.parametrize("change", ["moving", "unfinished", "damaged figures", "no splats"])
def test_other_runs_keep_their_error_which_says_what_is_left(run, change, capsys):
    folder = RunFolder(run)
    if change == "moving":
        figures = json.loads(folder.summary.read_text())
        folder.summary.write_text(json.dumps(figures | {"bytes_per_time": 9}))
    elif change == "unfinished":
        folder.summary.unlink()
    elif change == "damaged figures":
        folder.summary.write_text("{")
    else:
        folder.splats.unlink()
    found = find_run(str(run), print)
    assert or_splats_alone(found, "", None, print) is found
    assert main(["export", str(run), f"out={run / 'a.spz'}"]) == 2
    told = capsys.readouterr().err
    assert "there is no such file or folder any more." in told
    assert (f"without it: gsfw view {run}/splats.ply." in told) == (change != "no splats")


def test_what_needs_photos_or_another_state_is_not_served_by_splats(run, capsys):
    for words in (
        ("eval", str(run)),
        ("render", str(run), "what=views"),
        ("export", str(run)),
        ("export", str(run), "step=20", f"out={run / 'a.spz'}"),
        ("export", str(run), "keep=0.5", f"out={run / 'a.ply'}"),
        ("export", str(run), "format=gsfw"),
    ):
        before = (run / "splats.ply").read_bytes()
        assert main(list(words)) == 2, words
        assert "there is no such file or folder any more." in capsys.readouterr().err, words
        assert (run / "splats.ply").read_bytes() == before
