"""Tests of gsfw.commands.interface.new_run."""

import errno
import re
from pathlib import Path

import pytest

from gsfw.commands.interface.new_run import check_free, default_folder, new_run_folder
from gsfw.core.errors import OutputError
from gsfw.core.files.folder_lock import LOCK


def refusal(path) -> str:
    with pytest.raises(OutputError) as caught:
        check_free(str(path))
    return str(caught.value)


def test_a_new_or_empty_folder_is_free(tmp_path):
    check_free(str(tmp_path))
    check_free(str(tmp_path / "a" / "b"))


def test_a_folder_with_a_run_is_refused_with_both_ways_out(tmp_path):
    (tmp_path / "config.yaml").touch()
    assert refusal(tmp_path) == (
        f"out={tmp_path}: this folder holds a run already.\n"
        f"Continue it: gsfw resume {tmp_path}, or choose another folder with out=DIR."
    )


def test_a_folder_with_a_run_is_quoted_in_the_command_that_continues_it(tmp_path):
    run = tmp_path / "my run"
    run.mkdir()
    (run / "config.yaml").touch()
    assert f"gsfw resume '{run}', or" in refusal(run)


def test_a_folder_with_other_files_is_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    assert refusal(tmp_path) == (
        f"out={tmp_path}: this folder is not empty.\nChoose a new or empty folder with out=DIR."
    )


def test_a_file_in_the_way_is_named(tmp_path):
    (tmp_path / "file").touch()
    assert refusal(tmp_path / "file" / "run") == (
        f"out={tmp_path / 'file' / 'run'} cannot be written: {tmp_path / 'file'} is not a folder.\n"
        "Choose another with out=DIR."
    )


def test_a_place_one_may_not_write_to_is_named(read_only_folder):
    out = read_only_folder / "new" / "run"
    said = refusal(out)
    assert said.startswith(
        f"out={out} cannot be written: nothing can be written to {read_only_folder} ("
    )
    assert said.endswith("Choose another with out=DIR.")


def test_without_out_the_folder_of_runs_is_looked_at(read_only_folder, monkeypatch):
    monkeypatch.chdir(read_only_folder)
    with pytest.raises(OutputError) as caught:
        check_free("")
    assert str(caught.value).startswith(
        "runs, the folder of runs without out=DIR, cannot be written: nothing can be written to "
        f"{read_only_folder} ("
    )


def test_looking_leaves_nothing_behind(tmp_path):
    check_free(str(tmp_path / "new"))
    assert list(tmp_path.iterdir()) == []


def test_what_the_lock_of_an_earlier_start_has_left_is_no_obstacle(tmp_path):
    with new_run_folder(tmp_path / "run"):
        pass
    assert [item.name for item in (tmp_path / "run").iterdir()] == [LOCK]
    check_free(str(tmp_path / "run"))


def test_a_disk_without_locks_holds_runs_as_well(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("gsfw.core.files.folder_lock.fcntl.flock", refuse)
    with new_run_folder(tmp_path / "run") as first:
        with pytest.raises(OutputError, match="another gsfw train or resume is at work there"):
            new_run_folder(tmp_path / "run").__enter__()
        first.folder.config.write_text("seed: 1\n")
    assert sorted(item.name for item in (tmp_path / "run").iterdir()) == [LOCK, "config.yaml"]


def test_a_second_run_in_a_folder_is_refused_and_removes_nothing(tmp_path):
    with new_run_folder(tmp_path / "run") as first:
        first.folder.config.write_text("seed: 1\n")
        with pytest.raises(OutputError) as caught, new_run_folder(tmp_path / "run"):
            pass
        assert first.folder.config.is_file()
    assert re.fullmatch(
        rf"{tmp_path / 'run'}: another gsfw train or resume is at work there "
        r"\(process \d+ on .+, since .+ UTC\)\.\n"
        r"Wait for it, end it, or choose another folder with out=DIR\.",
        str(caught.value),
    )


def test_a_run_that_began_and_ended_since_the_first_look_is_not_written_over(tmp_path):
    check_free(str(tmp_path / "run"))
    with new_run_folder(tmp_path / "run") as first:
        first.folder.config.write_text("seed: 1\n")
        first.folder.write_checkpoint(0, {})
    with (
        pytest.raises(OutputError, match="holds a run already"),
        new_run_folder(tmp_path / "run"),
    ):
        pass
    assert (tmp_path / "run" / "config.yaml").is_file()


def test_a_run_that_was_killed_before_its_first_checkpoint_begins_again(tmp_path):
    with new_run_folder(tmp_path / "run") as killed:
        killed.folder.config.write_text("seed: 1\n")
        killed.folder.checkpoints.mkdir()
        (killed.folder.checkpoints / ".step_000000000.pt.part").write_bytes(b"half")
        (tmp_path / "run" / ".config.yaml.part").write_bytes(b"half")
    check_free(str(tmp_path / "run"))
    with new_run_folder(tmp_path / "run"):
        assert [item.name for item in (tmp_path / "run").iterdir()] == [LOCK]


def test_what_a_killed_training_has_not_left_is_never_removed(tmp_path):
    with new_run_folder(tmp_path / "run") as run:
        run.folder.config.write_text("seed: 1\n")
        run.folder.splats.write_bytes(b"a result without its checkpoints")
    with pytest.raises(OutputError, match="holds a run already"):
        check_free(str(tmp_path / "run"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "config.yaml").write_text("seed: 1\n")  # No training was here.
    with pytest.raises(OutputError, match="holds a run already"):
        check_free(str(tmp_path / "mine"))


def test_runs_that_would_get_the_same_name_get_numbers(tmp_path):
    with (
        new_run_folder(tmp_path / "a" / "now", is_chosen=False) as first,
        new_run_folder(tmp_path / "a" / "now", is_chosen=False) as second,
    ):
        assert first.folder.path == tmp_path / "a" / "now"
        assert second.folder.path == tmp_path / "a" / "now_2"


def test_the_default_folder_is_of_scene_method_and_time_and_never_taken_twice(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("time.strftime", lambda _: "now")
    first = default_folder("my scene/2", "3dgs")
    assert str(first) == "runs/my-scene-2/3dgs/now"
    first.mkdir(parents=True)
    assert str(default_folder("my scene/2", "3dgs")) == "runs/my-scene-2/3dgs/now_2"


def test_a_place_one_may_not_look_into_is_named(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(errno.EACCES, "Permission denied", str(path))

    monkeypatch.setattr(Path, "exists", refuse)
    out = tmp_path / "run"
    said = f"{out} cannot be written: Permission denied.\nChoose another place with out=DIR."
    assert refusal(out) == said
    with pytest.raises(OutputError) as caught, new_run_folder(out):
        pass
    assert str(caught.value) == said
    with pytest.raises(OutputError, match=r" cannot be written: Permission denied\."):
        default_folder("scene", "3dgs")


def start_and_fail(path, checkpoint: int | None, steps: int) -> None:
    with new_run_folder(path) as run:
        run.folder.config.write_text("seed: 1\n")
        if checkpoint is not None:
            run.folder.write_checkpoint(checkpoint, {})
        run.steps_done = lambda: steps
        raise RuntimeError


def failing_run(path, checkpoint: int | None = None, steps: int = 0) -> None:
    with pytest.raises(RuntimeError):
        start_and_fail(path, checkpoint, steps)


def test_a_run_that_fails_before_its_first_checkpoint_leaves_nothing(tmp_path):
    failing_run(tmp_path / "a" / "b" / "run")
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_fails_after_the_checkpoint_of_step_0_leaves_nothing(tmp_path):
    failing_run(tmp_path / "a" / "run", checkpoint=0)
    assert list(tmp_path.iterdir()) == []


def test_folders_that_were_there_stay(tmp_path):
    (tmp_path / "a" / "empty").mkdir(parents=True)
    (tmp_path / "a" / "other").touch()
    failing_run(tmp_path / "a" / "b" / "run")
    failing_run(tmp_path / "a" / "empty")
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["empty", "other"]


@pytest.mark.parametrize("checkpoint", [0, 1])
def test_a_run_that_has_trained_stays(tmp_path, checkpoint):
    failing_run(tmp_path / "run", checkpoint, steps=1)
    assert (tmp_path / "run" / "config.yaml").is_file()
