"""`gsfw runs` lists, compares and removes runs, from their files alone."""

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from gsfw.commands.main import main
from gsfw.core.files.folder_lock import LOCK, Owner, only_one
from gsfw.core.loop.run_folder import RunFolder

CONFIG = """\
schema: 1
gsfw: 0.1.0
given: [method, steps, {key}]
method: {method}
datamanager: colmap
data: /data/{scene}
steps: 100
{key}: {value}
optim.means_lr_steps: {value}
"""


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)


def make_run(path, scene="fox", method="3dgs", done=100, psnr=30.0, key="seed", value=1) -> Path:
    """The files of a run: a finished one if all 100 steps are done."""
    folder = RunFolder(Path("runs") / path)
    folder.checkpoints.mkdir(parents=True)
    (folder.path / LOCK).touch()
    folder.config.write_text(CONFIG.format(method=method, scene=scene, key=key, value=value))
    with zipfile.ZipFile(folder.checkpoint(done), "w") as file:
        file.writestr("data", b"0" * 1000)
    lines = [{"step": step, "num_gaussians": 500 + step, "step_ms": 10.0}
             for step in range(10, done + 1, 10)]  # fmt: skip
    folder.metrics_log.write_text("".join(json.dumps(line) + "\n" for line in lines))
    folder.evaluations.mkdir()
    (folder.evaluations / f"step_{done:09d}.json").write_text(json.dumps({"psnr": psnr}))
    (folder.evaluations / f"step_{done:09d}_train.json").write_text(json.dumps({"psnr": 99.0}))
    if done == 100:
        summary = {
            "completed": True, "scene": scene, "method": method, "psnr": psnr, "ssim": 0.9,
            "num_gaussians": 1234, "train_seconds": 65.0, "steps": 100, "model_bytes": 290_000,
            "protocol": {"views": 7},
        }  # fmt: skip
        folder.summary.write_text(json.dumps(summary))
    return folder.path


def listed(capsys, *arguments: str) -> list[dict]:
    assert main(["runs", *arguments, "json=true"]) == 0
    return json.loads(capsys.readouterr().out)


def refusal(capsys, *arguments: str) -> str:
    assert main(["runs", *arguments]) in (1, 2)
    said = capsys.readouterr().err
    assert "Traceback" not in said
    return said


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


def test_comparison_shows_what_differs(capsys):
    first, second = make_run("a"), make_run("b", psnr=31.5, value=2)
    assert main(["runs", "compare", str(first), str(second)]) == 0
    said = capsys.readouterr()
    lines = [" ".join(line.split()) for line in said.out.splitlines()]
    assert lines[:2] == [f"A {first}", f"B {second}"]
    assert "PSNR 30.00 dB 31.50 dB" in lines
    assert "model 290 kB 290 kB" in lines
    assert "seed 1 2" in lines
    assert "1 more differ, and follow from these (json=true has them)" in lines
    assert not [line for line in lines if line.startswith(("steps", "ssim"))]
    assert said.err == ""


def test_a_run_that_goes_on_is_not_compared_by_the_figures_of_its_earlier_end(capsys):
    runs = [make_run("a"), make_run("b")]
    config = runs[1] / "config.yaml"
    config.write_text(config.read_text().replace("steps: 100", "steps: 200"))
    (runs[1] / "eval" / "step_000000100.json").write_text('{"psnr": 27.0}')
    assert main(["runs", "compare", *map(str, runs), "json=true"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert document["figures"]["psnr"] == [30.0, 27.0]
    assert document["figures"]["model_bytes"] == [290_000, None]
    assert "B is not finished: its figures are those after 100 steps." in said.err


def test_comparison_of_runs_with_other_settings_has_dashes(capsys):
    runs = [make_run("a"), make_run("b", key="new_setting"), make_run("c", done=20)]
    assert main(["runs", "compare", *map(str, runs), "json=true"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["settings"]["new_setting"] == [None, 1, None]
    assert document["figures"]["psnr"] == [30.0, 30.0, 30.0]
    assert document["figures"]["ssim"] == [0.9, 0.9, None]
    assert document["chosen"] == ["seed", "new_setting"]


def test_a_setting_that_a_plugin_got_meanwhile_is_named_with_the_packages(capsys):
    first, second = make_run("a"), make_run("b")
    for run, version in ((first, "0.1"), (second, "0.2")):
        with (run / "config.yaml").open("a") as config:
            config.write(f"plugins:\n- my-method {version}\n")
    with (second / "config.yaml").open("a") as config:
        config.write("edge_weight: 0.05\n")
    assert main(["runs", "compare", str(first), str(second)]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert lines[lines.index("no chosen setting differs") :] == [
        "no chosen setting differs",
        "A B",
        "plugins my-method 0.1 my-method 0.2",
        "only B has edge_weight (0.05)",
    ]


def test_settings_of_another_method_are_not_told_one_by_one(capsys):
    first, second = make_run("a"), make_run("b", method="4dgs")
    with (second / "config.yaml").open("a") as config:
        config.write("motion_lr: 0.05\n")
    assert main(["runs", "compare", str(first), str(second)]) == 0
    assert "only B" not in capsys.readouterr().out


def test_figures_that_were_measured_differently_are_not_silently_compared(capsys):
    first, second = make_run("a"), make_run("b")
    summary = second / "metrics.json"
    summary.write_text(summary.read_text().replace('"views": 7', '"views": 9'))
    assert main(["runs", "compare", str(first), str(second)]) == 0
    assert capsys.readouterr().err == (
        "warning: The figures were not measured alike: views 7 in A, 9 in B.\n"
    )


def test_comparison_says_how_large_the_compared_images_were(capsys):
    first, second = make_run("a"), make_run("b")
    for run, sizes in ((first, "[[718, 1280]]"), (second, '[[239, 427]], "downscale": 3.0')):
        summary = run / "metrics.json"
        text = summary.read_text()
        summary.write_text(text.replace('"views": 7', f'"views": 7, "image_sizes": {sizes}'))
    assert main(["runs", "compare", str(first), str(second)]) == 0
    lines = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert main(["runs"]) == 0
    rows = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    assert " PSNR images Gaussians " in rows[0]
    assert sorted("239 x 427" in row for row in rows[1:]) == [False, True]
    assert "images 718 x 1280 pixels 239 x 427 pixels (1/3 of their size)" in lines


def test_one_run_is_too_few_for_a_comparison(capsys):
    path = make_run("a")
    assert refusal(capsys, "compare", str(path), f"{path}/") == (
        "error: gsfw runs compare: two or more runs are needed, and 1 given.\n"
        "gsfw runs lists them.\n"
    )


def test_an_unknown_action_suggests_the_nearest(capsys):
    assert "is neither compare nor remove. Did you mean 'remove'?" in refusal(capsys, "remov", "a")


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


def test_of_several_runs_one_that_must_stay_keeps_all(capsys):
    paths = [make_run("a"), make_run("b")]
    with only_one(paths[1], "nobody"):
        refusal(capsys, "remove", *map(str, paths), "yes=true")
    assert all(path.is_dir() for path in paths)


def test_a_damaged_run_can_be_removed(capsys):
    path = make_run("a")
    (path / "config.yaml").write_text("")
    assert main(["runs", "remove", str(path), "yes=true"]) == 0
    assert not path.exists()


def test_removal_needs_a_run(capsys):
    assert "gsfw runs remove: a run is needed, and 0 given." in refusal(capsys, "remove")
