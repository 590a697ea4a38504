"""`gsfw runs remove` frees disk space, and keeps what is no run or still in use."""

import json
from pathlib import Path

import pytest
from support.run_files import make_run, refusal

from gsfw.commands.main import main
from gsfw.core.files.folder_lock import only_one

pytestmark = pytest.mark.usefixtures("empty_folder")


def test_removal_frees_what_it_says_and_leaves_no_empty_folders(capsys):
    path, other = make_run("fox/3dgs/1"), make_run("plush/3dgs/1")
    size = sum(item.stat().st_size for item in path.rglob("*") if item.is_file())
    assert main(["runs", "remove", str(path), "yes=true", "json=true"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "removed": [{"run": str(path), "bytes": size}], "bytes": size,
    }  # fmt: skip
    assert not Path("runs/fox").exists()
    assert other.is_dir()


def test_a_run_that_cannot_be_written_to_is_not_removed(capsys):
    path = make_run("a")
    (path / ".lock").unlink(missing_ok=True)
    (path / ".lock").mkdir()
    said = refusal(capsys, "remove", str(path), "yes=true")
    assert "cannot be written: " in said
    assert "Choose a run that you may change." in said
    assert path.is_dir()


def answering(monkeypatch, answer: str) -> None:
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stdin.readline", lambda: answer, raising=False)


def test_removal_asks_first(capsys, monkeypatch):
    path = make_run("a")
    for answer in ("", "\n", "n\n", "what\n"):
        answering(monkeypatch, answer)
        assert main(["runs", "remove", str(path)]) == 0
        said = capsys.readouterr().out
        assert said.startswith(f"remove {path} (3dgs on fox, finished, PSNR 30.00 dB, ")
        assert said.endswith("? [y/N] kept\n")
    answering(monkeypatch, "y\n")
    assert main(["runs", "remove", str(path)]) == 0
    assert f"removed {path}: " in capsys.readouterr().out
    assert not path.exists()


def test_where_nobody_can_be_asked_nothing_is_removed(capsys):
    path = make_run("a")
    assert "Write yes=true to remove" in refusal(capsys, "remove", str(path))
    assert path.is_dir()


def test_a_running_run_is_not_removed(capsys):
    path = make_run("a", done=40)
    with only_one(path, "nobody"):
        assert f"error: {path} is trained on now (process " in refusal(
            capsys, "remove", str(path), "yes=true"
        )
    assert path.is_dir()


def test_what_is_no_run_is_not_removed(capsys):
    project = Path("project")
    (project / "checkpoints").mkdir(parents=True)
    (project / "config.yaml").write_text("method: gradient descent\nname: mine\n")
    assert "does not look like a run of gsfw" in refusal(capsys, "remove", "project", "yes=true")
    (project / "config.yaml").unlink()
    assert "project is not a run: it has no config.yaml." in refusal(
        capsys, "remove", "project", "yes=true"
    )
    assert "there is no run nowhere." in refusal(capsys, "remove", "nowhere", "yes=true")
    assert project.is_dir()


def test_a_run_that_holds_others_a_link_and_a_checkpoint_are_not_removed(capsys):
    outer = make_run("a")
    make_run("a/b")
    assert "runs/a holds other runs, such as runs/a/b." in refusal(
        capsys, "remove", str(outer), "yes=true"
    )
    Path("link").symlink_to(outer / "b")
    assert "link is a link to " in refusal(capsys, "remove", "link", "yes=true")
    checkpoint = outer / "b" / "checkpoints" / "step_000000100.pt"
    assert "is a file, and whole runs are removed." in refusal(
        capsys, "remove", str(checkpoint), "yes=true"
    )
    assert checkpoint.is_file()


@pytest.mark.parametrize("inside", [".", "checkpoints"])
def test_a_run_is_not_removed_from_inside_of_it(capsys, monkeypatch, inside):
    path = make_run("a b").resolve()
    monkeypatch.chdir(path / inside)
    name = "." if inside == "." else ".."
    for given in (name, str(path)):
        assert refusal(capsys, "remove", given, "yes=true") == (
            f"error: {path} cannot be removed from inside of it (you are in {Path.cwd()}).\n"
            f"Leave it first: cd {path.parent}\n"
        )
    assert path.is_dir()


def test_a_run_is_removed_under_any_name_of_it(capsys):
    path = make_run("a")
    assert main(["runs", "remove", f"{path}/checkpoints/..", "yes=true"]) == 0
    assert not path.exists()


def test_a_damaged_run_can_be_removed(capsys):
    path = make_run("a")
    (path / "config.yaml").write_text("")
    assert main(["runs", "remove", str(path), "yes=true"]) == 0
    assert not path.exists()


def test_removal_needs_a_run(capsys):
    assert refusal(capsys, "remove") == (
        "error: gsfw runs remove: no run is given.\n"
        "Write gsfw runs remove RUN; gsfw runs lists them.\n"
    )


def test_of_several_runs_one_that_must_stay_keeps_all(capsys):
    paths = [make_run("a"), make_run("b")]
    with only_one(paths[1], "nobody"):
        refusal(capsys, "remove", *map(str, paths), "yes=true")
    assert all(path.is_dir() for path in paths)
