"""The journal: finished stages are kept, changed ones and all after them are made again."""

import json

import pytest

from gsfw.preparation.journal import Journal, identity_of


class Stages:
    """Three stages; counts how often each is made and cleared."""

    def __init__(self, path):
        self.path, self.made, self.cleared = path, [], []

    def run(self, fail="", there=True, **settings):
        self.made, self.cleared = [], []
        journal = Journal(self.path)
        for name in "abc":

            def make(name=name):
                if name == fail:
                    raise KeyboardInterrupt
                self.made.append(name)
                return {"of": name, "number": 1.5}

            result = journal.stage(
                name,
                {"x": settings.get(name, 0)},
                make,
                lambda name=name: self.cleared.append(name),
                lambda found, name=name: found["of"] == name and (there or name != "b"),
            )
            assert result == {"of": name, "number": 1.5}
        return journal


@pytest.fixture
def stages(tmp_path):
    return Stages(tmp_path / "stages.json")


def test_a_second_run_makes_nothing(stages):
    stages.run()
    assert (stages.made, stages.cleared) == (["a", "b", "c"], ["a", "b", "c"])
    journal = stages.run()
    assert (stages.made, stages.cleared) == ([], [])
    assert list(journal.seconds) == ["a", "b", "c"]


def test_another_setting_repeats_its_stage_and_those_after_it(stages):
    stages.run()
    stages.run(b=1)
    assert (stages.made, stages.cleared) == (["b", "c"], ["b", "c"])
    stages.run(b=1)
    assert stages.made == []


def test_an_interrupted_stage_goes_on_with_what_it_left(stages):
    with pytest.raises(KeyboardInterrupt):
        stages.run(fail="b")
    assert (stages.made, stages.cleared) == (["a"], ["a", "b"])
    stages.run()
    assert (stages.made, stages.cleared) == (["b", "c"], ["c"])


def test_an_interrupted_stage_of_other_settings_is_cleared_first(stages):
    with pytest.raises(KeyboardInterrupt):
        stages.run(fail="b")
    stages.run(b=2)
    assert (stages.made, stages.cleared) == (["b", "c"], ["b", "c"])


def test_a_stage_whose_files_are_gone_is_made_again(stages):
    stages.run()
    stages.run(there=False)
    assert (stages.made, stages.cleared) == (["b", "c"], ["b", "c"])


@pytest.mark.parametrize("content", ["", "{", "[]", '{"schema": 0, "stages": {}}', '{"schema": 1}'])
def test_a_journal_that_cannot_be_read_begins_anew(stages, content):
    stages.run()
    stages.path.write_text(content)
    stages.run()
    assert stages.cleared == ["a", "b", "c"]
    assert json.loads(stages.path.read_text())["schema"] == 1


def test_a_file_that_was_changed_is_another(tmp_path):
    path = tmp_path / "a"
    path.write_text("1")
    before = identity_of(path)
    assert identity_of(path) == before
    path.write_text("12")
    assert identity_of(path) != before


@pytest.mark.parametrize(
    "entry",
    [
        {},
        [],
        {"key": 3, "finished": True, "seconds": 1.0, "result": {}},
        {"key": "", "finished": 1, "seconds": 1.0, "result": {}},
        {"key": "", "finished": True, "seconds": True, "result": {}},
        {"key": "", "finished": True, "seconds": 1.0, "result": 3},
    ],
)
def test_a_stage_that_is_not_whole_is_made_again(tmp_path, entry):
    path = tmp_path / "journal.json"
    stages = Stages(path)
    stages.run()
    document = json.loads(path.read_text())
    document["stages"]["b"] = entry
    path.write_text(json.dumps(document))
    stages.run()
    assert stages.made[0] == "b"
    assert Journal(path).seconds == {}
