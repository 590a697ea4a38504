"""The folder of a prepared data set."""

import pytest

from gsfw.core.errors import DataError, OutputError
from gsfw.preparation.workspace import Workspace


def test_a_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").touch()
    place = Workspace(tmp_path / "out")
    with pytest.raises(OutputError) as caught, place.claimed(()):
        pass
    assert str(caught.value) == (
        f"out={tmp_path / 'out'} is not empty, and not a folder of gsfw prepare (it holds "
        "thesis.tex).\nGive a new folder; nothing in this one was touched."
    )


def test_a_folder_that_has_its_own_work_in_it_is_left_alone(tmp_path):
    (tmp_path / "work").mkdir()
    (tmp_path / "images").mkdir()
    with (
        pytest.raises(
            OutputError, match=r"not a folder of gsfw prepare \(it holds images and more"
        ),
        Workspace(tmp_path).claimed(()),
    ):
        pass


def test_what_is_left_of_a_preparation_that_was_killed_at_once_is_its_folder(tmp_path):
    (tmp_path / "work").mkdir()
    with Workspace(tmp_path).claimed(()):
        assert (tmp_path / "work").is_dir()


def test_a_result_whose_work_was_removed_is_still_one(tmp_path):
    (tmp_path / "images").mkdir()
    (tmp_path / "prepare.json").touch()
    with Workspace(tmp_path).claimed(()):
        assert (tmp_path / "work").is_dir()


@pytest.mark.parametrize(("given", "out"), [("a", "a"), ("a/b", "a"), ("a/v.mp4", "a")])
def test_what_the_result_is_made_from_does_not_lie_in_it(tmp_path, given, out):
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "a" / "v.mp4").touch()
    place = Workspace(tmp_path / out)
    with pytest.raises(OutputError) as caught, place.claimed((tmp_path / given,)):
        pass
    assert str(caught.value) == (
        f"out={tmp_path / out} holds {tmp_path / given}, which the result is made from.\n"
        "Give a folder of its own: what is there already stays as it is."
    )


@pytest.mark.parametrize("out", ["a/out", "b"])
def test_the_result_may_lie_in_or_beside_the_input(tmp_path, out):
    (tmp_path / "a").mkdir()
    with Workspace(tmp_path / out).claimed((tmp_path / "a",)):
        pass


def test_a_video_may_lie_beside_the_result(tmp_path):
    (tmp_path / "v.mp4").touch()
    with Workspace(tmp_path / "out").claimed((tmp_path / "v.mp4",)):
        pass


def test_two_programs_do_not_work_on_one_result(tmp_path):
    place = Workspace(tmp_path / "out")
    with (
        place.claimed(()),
        pytest.raises(OutputError, match="another gsfw prepare is at work there"),
        Workspace(tmp_path / "out").claimed(()),
    ):
        pass


def test_what_stages_left_is_removed(tmp_path):
    place = Workspace(tmp_path / "out")
    with place.claimed(()):
        place.images.mkdir()
        (place.images / "a.png").touch()
        place.report.touch()
        place.remove(place.images, place.report, place.sparse)
        assert sorted(item.name for item in place.path.iterdir()) == ["work"]
    with place.claimed(()):
        pass


def fail_with(place, *made):
    """Take the folder, make something in it, and fail."""
    with place.claimed(()):
        place.log.mkdir()
        (place.log / "colmap-INFO").touch()
        for name in made:
            (place.work / name).touch()
        raise DataError("no image can be used.")


def test_nothing_is_left_of_inputs_that_are_refused(tmp_path):
    with pytest.raises(DataError):
        fail_with(Workspace(tmp_path / "prepared" / "out"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("before", [True, False])
def test_the_work_of_a_stage_stays_after_an_error(tmp_path, before):
    place = Workspace(tmp_path / "out")
    if before:
        with place.claimed(()):
            pass
    with pytest.raises(DataError):
        fail_with(place, *(() if before else ("database.db",)))
    assert place.work.is_dir()
    with place.claimed(()):
        assert (place.work / "database.db").exists() is not before


def test_a_file_in_the_place_of_the_folder_is_told(tmp_path):
    (tmp_path / "out").touch()
    with pytest.raises(OutputError, match="out"), Workspace(tmp_path / "out").claimed(()):
        pass


def test_a_link_to_itself_in_the_place_of_the_folder_is_told(tmp_path):
    (tmp_path / "out").symlink_to(tmp_path / "out")
    message = "out/work cannot be written: "
    with (
        pytest.raises(OutputError, match=message),
        Workspace(tmp_path / "out").claimed((tmp_path,)),
    ):
        pass
