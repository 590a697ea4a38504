"""`gsfw runs` lists runs, from their files alone."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.run_files import listed, make_run, refusal

from gsfw.commands.main import main
from gsfw.core.files.folder_lock import LOCK, Owner, only_one
from gsfw.core.loop.run_folder import RunFolder

pytestmark = pytest.mark.usefixtures("empty_folder")


def test_a_finished_run_has_the_figures_of_its_summary(capsys):
    path = make_run("a")
    (record,) = listed(capsys)
    assert record == {
        "path": str(path), "state": "finished", "scene": "fox", "method": "3dgs",
        "started": None, "steps": 100, "steps_done": 100, "psnr": 30.0, "gaussians": 1234,
        "train_seconds": 65.0, "why": "",
    }  # fmt: skip


def test_an_interrupted_run_has_the_figures_of_its_logs(capsys):
    make_run("a", done=40, psnr=25.0)
    (record,) = listed(capsys)
    assert (record["state"], record["steps_done"], record["psnr"]) == ("interrupted", 40, 25.0)
    assert (record["gaussians"], record["train_seconds"]) == (540, pytest.approx(0.4))


def test_a_finished_run_that_is_to_go_on_is_interrupted(capsys):
    path = make_run("a")
    config = path / "config.yaml"
    config.write_text(config.read_text().replace("steps: 100", "steps: 200"))
    assert listed(capsys)[0]["state"] == "interrupted"


def test_a_run_that_was_set_back_is_interrupted_for_every_command(capsys):
    path = make_run("a", done=40)
    shutil.copy(make_run("b") / "metrics.json", path)  # Of the end before it was set back.
    record = next(one for one in listed(capsys) if one["path"] == str(path))
    assert (record["state"], record["steps_done"], record["gaussians"]) == ("interrupted", 40, 540)
    assert main(["info", str(path), "json=true"]) == 0
    described = json.loads(capsys.readouterr().out)
    assert (described["finished"], described["steps_done"]) == (False, 40)
    assert described["metrics"]["num_gaussians"] == 540


def test_a_run_that_somebody_trains_is_running(capsys):
    path = make_run("a", done=40)
    with only_one(path, "nobody"):
        (record,) = listed(capsys)
        assert record["state"] == "running"
        assert record["why"].startswith("process ")
        assert main(["runs"]) == 0
        assert "running 40%" in capsys.readouterr().out
    assert listed(capsys)[0]["state"] == "interrupted"


def test_a_run_whose_process_was_killed_is_not_running(capsys):
    path = make_run("a", done=40)
    (path / LOCK).write_bytes(Owner.this().encoded())  # This process lives, and has no lock.
    assert listed(capsys)[0]["state"] == "interrupted"
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    gone = Owner(process.pid, Owner.this().host, "").encoded()
    (path / LOCK).write_bytes(gone)
    assert listed(capsys)[0]["state"] == "interrupted"


DAMAGES = {
    "config.yaml cannot be read": lambda folder: folder.config.write_text("{"),
    "config.yaml names no method": lambda folder: folder.config.write_text(""),
    "metrics.json is not valid JSON": lambda folder: folder.summary.write_text('{"psnr": 3'),
    "step_000000100.pt is cut short or is no checkpoint":
        lambda folder: folder.checkpoint(100).write_bytes(b"PK"),
}  # fmt: skip


@pytest.mark.parametrize("why", DAMAGES)
def test_a_damaged_run_says_why(capsys, why):
    path = make_run("a")
    DAMAGES[why](RunFolder(path))
    (record,) = listed(capsys)
    assert (record["state"], record["why"]) == ("damaged", why)
    assert main(["runs"]) == 0
    assert f"\ndamaged: {path}: {why}\n" in capsys.readouterr().out


def test_a_run_whose_checkpoints_may_not_be_read_leaves_the_others_in_the_list(capsys, monkeypatch):
    make_run("a")
    make_run("b", done=40)

    def refuse(folder):
        if folder.path.name == "a":
            raise PermissionError(13, "Permission denied", str(folder.checkpoints))
        return folder.checkpoint(40)

    monkeypatch.setattr(RunFolder, "latest_checkpoint", refuse)
    found = {Path(record["path"]).name: record for record in listed(capsys)}
    assert (found["a"]["state"], found["b"]["state"]) == ("damaged", "interrupted")
    assert found["a"]["why"].endswith("a/checkpoints cannot be read: Permission denied")


def test_a_checkpoint_that_may_not_be_read_is_not_called_cut_short(capsys, monkeypatch):
    make_run("a")
    monkeypatch.setattr("os.access", lambda path, mode: False)
    (record,) = listed(capsys)
    assert record["why"] == "step_000000100.pt cannot be read: check its permissions"


def test_a_run_without_a_checkpoint_is_damaged_unless_it_is_finished(capsys):
    shutil.rmtree(make_run("a", done=40) / "checkpoints")
    shutil.rmtree(make_run("b") / "checkpoints")
    states = {Path(record["path"]).name: record["state"] for record in listed(capsys)}
    assert states == {"a": "damaged", "b": "finished"}


def test_runs_are_filtered_and_sorted(capsys):
    make_run("a", scene="fox", psnr=20.0)
    make_run("b", scene="plush", psnr=30.0)
    make_run("c", scene="fox", method="4dgs", psnr=25.0)
    make_run("d", scene="fox", done=10, psnr=10.0)

    def names(*arguments: str) -> str:
        return "".join(Path(record["path"]).name for record in listed(capsys, *arguments))

    assert names("sort=psnr") == "bcad"
    assert names("sort=gaussians")[0] == "d"
    assert names("sort=scene")[-1] == "b"
    assert names("scene=fox", "sort=psnr") == "cad"
    assert names("scene=f*", "method=4d*") == "c"
    assert names("state=interrupted") == "d"
    assert names("state=running") == ""


def test_without_a_match_scenes_and_methods_are_named(capsys):
    make_run("a")
    assert main(["runs", "scene=plush"]) == 0
    assert capsys.readouterr().out == (
        "No run matches scene=plush (1 run in all).\nScenes: fox. Methods: 3dgs.\n"
    )


def test_the_filter_that_matches_nothing_is_repeated(capsys):
    make_run("a")
    make_run("b")
    assert main(["runs", "method=4d*", "state=interrupted"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("No run matches state=interrupted method=4d* (2 runs in all).\n")


def test_without_runs_the_command_that_makes_one_is_named(capsys, tmp_path):
    assert main(["runs"]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"there are no runs in {tmp_path / 'runs'}, and none")
    assert out.endswith("Train one: gsfw train method=3dgs\n")


def test_the_table_has_a_line_for_each_run(capsys):
    make_run("a")
    make_run("b", done=40)
    assert main(["runs", "sort=psnr"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["state", "scene", "method", "PSNR", "images", "Gaussians", "time", "run"]
    assert [
        "finished",
        "fox",
        "3dgs",
        "30.00",
        "-",
        "1,234",
        "1",
        "min",
        "5",
        "s",
        "runs/a",
    ] in lines
    assert ["interrupted", "40%", "fox", "3dgs", "30.00", "-", "540", "0", "s", "runs/b"] in lines


def test_on_a_narrow_terminal_folders_have_their_own_lines(capsys, monkeypatch):
    path = make_run("a-long/name/of-a-run/2026-11-23_10-00-00")
    monkeypatch.setenv("COLUMNS", "60")
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    assert main(["runs"]) == 0
    assert f"\n  {path}\n" in capsys.readouterr().out


@pytest.mark.parametrize("words", [[], ["compare", "runs/a", "runs/b"]])
def test_neither_listing_nor_comparing_imports_torch(words):
    make_run("a")
    make_run("b")
    code = (
        "import sys; from gsfw.commands.main import main; "
        f"main({['runs', *words]}); print(*sys.modules)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert "runs/a" in result.stdout
    assert not {"torch", "numpy"} & set(result.stdout.split())


def test_a_real_run_is_read(finished_run, capsys):
    shutil.copytree(finished_run, "runs/real")
    (record,) = listed(capsys)
    summary = json.loads(RunFolder(finished_run).summary.read_text())
    assert (record["state"], record["scene"], record["method"]) == (
        "finished", "synthetic", "3dgs",
    )  # fmt: skip
    assert record["psnr"] == summary["psnr"]
    RunFolder(Path("runs/real")).summary.unlink()
    (record,) = listed(capsys)
    assert (record["state"], record["psnr"]) == ("interrupted", summary["psnr"])


def test_an_unknown_action_suggests_the_nearest(capsys):
    assert "is neither compare nor remove. Did you mean 'remove'?" in refusal(capsys, "remov", "a")
