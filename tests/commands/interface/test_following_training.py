"""`gsfw prepare ... train=true ...`: two commands in one line, each with its own keys."""

import json
import shutil

import pytest

from gsfw.commands.interface.console import Console
from gsfw.commands.interface.following_training import FollowingTraining, split
from gsfw.commands.main import main
from gsfw.core.errors import ConfigError, OutputError

SUGGESTED = {"method": "3dgs", "data": "scene", "downscale": "4", "exposure": "true"}


@pytest.mark.parametrize(
    ("typed", "own", "following"),
    [
        ("a out=b", "a out=b", None),
        ("a out=b train=false", "a out=b train=false", None),
        ("a out=b train=true", "a out=b train=true", ""),
        ("a train=yes minutes=3 out=c", "a train=yes", "minutes=3 out=c"),
        ("a --train true --minutes 3", "a --train true", "--minutes 3"),
        ("a --train=1 minutes=3", "a --train=1", "minutes=3"),
        ("a again=true train=true again=true", "a again=true train=true", "again=true"),
    ],
)
def test_words_before_and_after_train_are_of_two_commands(typed, own, following):
    assert split(typed.split()) == (own.split(), None if following is None else following.split())


def test_a_switch_that_is_neither_true_nor_false_is_refused():
    with pytest.raises(ConfigError, match="train=3: expected true or false"):
        split(["a", "train=3"])


def told(capsys, tmp_path, *words):
    """The error of a command over a folder of photos, of which nothing may be read yet."""
    photos = tmp_path / "photos"
    photos.mkdir(exist_ok=True)
    out = tmp_path / "out"
    assert main(["prepare", str(photos), f"out={out}", *words]) == 2
    assert not out.exists()
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message", "advice"),
    [
        ("minutes=3", "unknown key 'minutes'", "those of gsfw train after it"),
        ("minuts=3 train=true", "unknown key 'minuts'", "those of gsfw train after it"),
        ("train=true minuts=3", "Did you mean 'minutes'?", "gsfw prepare stand before train=true"),
        ("train=true frames=90", "unknown key 'frames'", "Keys of gsfw prepare stand before"),
        ("train=true minutes=0", "minutes=0: expected more", "Give the time that you want"),
        ("train=true minutes=2 steps=9", "ends after a time or after a number", "Leave out"),
        ("train=true data=b", "the data set is the one that is prepared", "Leave it out."),
        ("train=true walk.mp4", "'walk.mp4' after train=true", "see gsfw prepare --help"),
        ("train=perhaps", "train=perhaps: expected true or false", ""),
    ],
)
def test_mistakes_name_the_command_whose_key_it_is_before_any_work(
    capsys, tmp_path, words, message, advice
):
    said = told(capsys, tmp_path, *words.split())
    assert message in said
    assert advice in said


class Verbs:
    """Train and resume, which write the files of a run."""

    def __init__(self, run):
        self.run, self.called, self.interrupted = run, [], False

    def start(self, words):
        self.called.append(("train", words))
        self.run.mkdir(parents=True)
        (self.run / "config.yaml").touch()
        if not self.interrupted:
            self.finish()
        return 130 if self.interrupted else 0

    def go_on(self, words):
        self.called.append(("resume", words))
        self.finish()
        return 0

    def finish(self):
        (self.run / "metrics.json").touch()
        (self.run / "splats.ply").touch()

    def train(self, training, json=False):
        """The exit code, and what was called."""
        self.called, self.run = [], training.run
        return training.train(self.start, self.go_on, Console(json)), self.called


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    (tmp_path / "sparse" / "0" / "images.bin").write_bytes(b"poses")
    (tmp_path / "work").mkdir()
    return tmp_path


def test_the_suggested_settings_give_way_to_typed_ones_and_to_a_time(scene):
    def command(*words):
        return FollowingTraining(scene, words, SUGGESTED).command

    out = f"out={scene / 'run'}"
    first = ["method=3dgs", "data=scene"]
    assert command() == [*first, "exposure=true", out]
    assert command("minutes=3") == [*first, "exposure=true", out, "minutes=3"]
    assert command("steps=9") == [*first, "downscale=4", "exposure=true", out, "steps=9"]
    assert command("exposure=false", "out=a") == [*first, "exposure=false", "out=a"]
    assert command("preset=fast", "minutes=3")[2] == "exposure=true"
    assert command("preset=fast")[2] == "downscale=4"
    assert command("steps=auto")[2] == "exposure=true"


def test_the_suggested_settings_give_way_to_those_of_a_file(scene):
    file = scene / "mine.yaml"
    file.write_text("data: elsewhere\nmethod: 2dgs\nexposure: false\nsteps: 9\n")
    training = FollowingTraining(scene, (f"config={file}",), SUGGESTED)
    out = f"out={scene / 'run'}"
    assert training.command == ["data=scene", "downscale=4", out, f"config={file}"]


def test_a_file_is_checked_with_the_method_that_it_names(tmp_path, capsys):
    file = tmp_path / "mine.yaml"
    file.write_text("method: 4dgs\ndeformation.width: wide\n")
    said = told(capsys, tmp_path, "train=true", f"config={file}")
    assert "unknown key 'deformation.width'" in said
    assert "gsfw train method=4dgs --help" in said


def test_a_second_start_has_nothing_left_to_do(scene, capsys):
    verbs, training = Verbs(scene / "run"), FollowingTraining(scene, ("minutes=3",), SUGGESTED)
    assert verbs.train(training) == (0, [("train", training.command)])
    assert verbs.train(training) == (0, [])
    assert f"{scene / 'run'} is finished already: {scene / 'run' / 'splats.ply'}" in (
        capsys.readouterr().out
    )


def test_an_interrupted_training_goes_on(scene):
    verbs, training = Verbs(scene / "run"), FollowingTraining(scene, (), SUGGESTED)
    verbs.interrupted = True
    assert verbs.train(training)[0] == 130
    assert verbs.train(training) == (0, [("resume", [str(scene / "run")])])


def test_a_run_of_other_settings_or_data_is_left_alone(scene):
    verbs = Verbs(scene / "run")
    verbs.train(FollowingTraining(scene, ("minutes=3",), SUGGESTED))
    with pytest.raises(OutputError, match="was trained with other settings") as caught:
        verbs.train(FollowingTraining(scene, ("minutes=9",), SUGGESTED))
    assert "out=DIR after train=true" in caught.value.advice
    (scene / "sparse" / "0" / "images.bin").write_bytes(b"other poses")
    with pytest.raises(OutputError, match="or on an earlier data set"):
        verbs.train(FollowingTraining(scene, ("minutes=3",), SUGGESTED))


def test_a_run_whose_record_was_deleted_is_told_how_to_go_on(scene):
    verbs, training = Verbs(scene / "run"), FollowingTraining(scene, ("minutes=3",), SUGGESTED)
    verbs.train(training)
    shutil.rmtree(scene / "work")
    with pytest.raises(OutputError, match=r"work/training_\w+\.json, .* is missing") as caught:
        verbs.train(training)
    assert f"gsfw resume {scene / 'run'} continues" in caught.value.advice
    assert "out=DIR after train=true" in caught.value.advice


def test_each_run_of_a_data_set_is_remembered(scene, capsys):
    verbs = Verbs(scene)
    first = FollowingTraining(scene, ("minutes=3",), SUGGESTED)
    other = FollowingTraining(scene, ("minutes=9", f"out={scene / 'b'}"), SUGGESTED)
    verbs.interrupted = True
    assert verbs.train(first)[0] == 130
    verbs.interrupted = False
    assert verbs.train(other) == (0, [("train", other.command)])
    assert verbs.train(first) == (0, [("resume", [str(scene / "run")])])
    assert verbs.train(other) == (0, [])
    assert verbs.train(first) == (0, [])


@pytest.mark.parametrize(
    "words",
    [
        "seed=4 minutes=3",
        "--minutes 3 --seed 4",
        "minutes=3 seed=4 json=true",
        "minutes=3 seed=4 --debug",
        "minutes=3 seed=4 viewer=true viewer.port=90",
        "minutes=9 minutes=3 seed=4",
        "minutes=3 seed=4 method=3dgs",
    ],
)
def test_the_same_settings_in_other_words_are_the_same_run(scene, words):
    verbs = Verbs(scene)
    verbs.train(FollowingTraining(scene, ("minutes=3", "seed=4"), SUGGESTED))
    assert verbs.train(FollowingTraining(scene, tuple(words.split()), SUGGESTED)) == (0, [])


def test_a_file_with_other_content_is_another_run(scene):
    verbs, file = Verbs(scene), scene / "mine.yaml"
    training = FollowingTraining(scene, (f"config={file}",), SUGGESTED)
    file.write_text("seed: 4\n")
    verbs.train(training)
    assert verbs.train(training) == (0, [])
    file.write_text("seed: 5\n")
    with pytest.raises(OutputError, match="was trained with other settings"):
        verbs.train(training)


def test_an_interrupted_training_goes_on_as_it_is_to_be_shown(scene):
    verbs = Verbs(scene)
    verbs.interrupted = True
    verbs.train(FollowingTraining(scene, (), SUGGESTED))
    shown = FollowingTraining(scene, ("json=true", "viewer=true", "--debug"), SUGGESTED)
    words = [str(scene / "run"), "viewer=true", "json=true"]
    assert verbs.train(shown, json=True) == (0, [("resume", words)])


def test_a_dry_run_neither_trains_nor_is_remembered(scene):
    verbs, training = Verbs(scene), FollowingTraining(scene, (), SUGGESTED)
    verbs.interrupted = True
    verbs.train(training)
    dry = FollowingTraining(scene, ("seed=4", "--dry-run"), SUGGESTED)
    called = []
    assert dry.train(lambda words: called.append(words) or 0, verbs.go_on, Console()) == 0
    assert called == [dry.command]
    assert verbs.train(training) == (0, [("resume", [str(scene / "run")])])


def test_a_finished_training_without_splats_is_told_with_what_writes_them(scene, capsys):
    verbs, training = Verbs(scene), FollowingTraining(scene, (), SUGGESTED)
    verbs.train(training)
    (scene / "run" / "splats.ply").unlink()
    assert verbs.train(training) == (0, [])
    said = capsys.readouterr().out
    assert "is finished already, but has no splats.ply." in said
    assert f"gsfw export {scene / 'run'}" in said


def test_a_finished_training_gives_programs_a_document(scene, capsys):
    verbs, training = Verbs(scene), FollowingTraining(scene, ("json=true",), SUGGESTED)
    verbs.train(training, json=True)
    capsys.readouterr()
    verbs.train(training, json=True)
    said = capsys.readouterr()
    assert json.loads(said.out) == {"run": str(scene / "run"), "completed": True}
    assert "is finished already" in said.err
