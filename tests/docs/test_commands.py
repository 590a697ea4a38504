"""Every command line of the documentation is one that gsfw understands; none is run here."""

import ast
import re

import pytest
from support.pages import PAGES, ROOT, Command, blocks, commands, spans
from support.reading_commands import read_command
from support.small_captures import ring, write_images, write_transforms

from gsfw.commands.interface.arguments import HelpRequested
from gsfw.core.errors import UserError
from gsfw.plugins.loading import load_all
from gsfw.plugins.registry import installed

# What is checked are the documents; shapes are those of other tests.
pytestmark = pytest.mark.unchecked

CAPTURES = (
    "DIR",
    "DATA",
    "scene",
    "fox",
    "chair",
    "plush",
    "robot",
    "path/to/capture",
    "captures/fox",
    "OUT",
)
"""Names of data sets in the documents."""

LETTERS = {"N": "2", "NAME": "3dgs", "KEY": "steps", "format=NAME": "ply"}
"""Values for the words that stand for one in a sentence."""

OWN = {"method=my-method": "method=3dgs"}
"""Parts in place of those that a reader has written."""

CONFIGS = ("RUN/config.yaml", "runs/x/config.yaml", "runs/first/config.yaml")
"""Names of files of settings."""

WORDS = {
    "blocks": ["city"],
    "check": ["DIR"],
    "convert": ["splats.ply", "splats.spz"],
    "partition": ["DIR"],
    "prepare": ["photos"],
}
"""Words that a verb needs."""

OF_A_RUN = ("eval", "export", "open", "render", "report", "resume", "view")
"""Verbs with a word for a run."""

OTHERS = {
    ".", "apt-get", "benchmarks/gpu.sh", "cd", "conda", "git", "mypy", "pip", "pytest", "python",
    "python3", "ray", "torchrun", "ruff", "tensorboard",
}  # fmt: skip
"""Other programs that documents may name."""


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """A folder with a small capture and a file of settings under each name of the documents."""
    folder = tmp_path_factory.mktemp("places")
    capture = ring()
    for name in CAPTURES:
        (folder / name).mkdir(parents=True)
        write_transforms(folder / name / "transforms.json", capture)
        write_images(folder / name / "images", capture)
    (folder / "city").mkdir()
    (folder / "city" / "partition.json").write_text("{}")
    for name in CONFIGS:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("method: 3dgs\n")
    return folder


def completed(command: Command) -> Command:
    """A command within a sentence, which leaves out what does not matter there."""
    verb, *words = command.words[1:]
    for place, word in enumerate(words):
        key, _, value = word.partition("=")
        words[place] = f"{key}={LETTERS.get(word, LETTERS.get(value, value))}" if value else word
    keys = {word.partition("=")[0] for word in words}
    if verb == "train" and not keys & {"method", "config"}:
        words.append("method=3dgs")
    if verb != "train" and not any(re.match(r"[^-=]+$", word) for word in words):
        words += WORDS.get(verb, [])
        words += ["latest"] if verb in OF_A_RUN else []
    if (verb, words) == ("plugins", ["check"]):
        words.append("my-method")
    return Command(command.place, ("gsfw", verb, *words))


def local(word: str) -> str:
    """A word with a data set that is here in place of one at an address."""
    return re.sub(r"^(data=)?\w+://.*", r"\1fox", word)


def lies(found: list[Command]) -> list[str]:
    """The commands of gsfw that it does not understand, each with its message."""
    wrong = []
    for command in found:
        if command.words[0] != "gsfw":
            continue
        try:
            read_command([OWN.get(word, local(word)) for word in command.words[1:]])
        except UserError as error:
            wrong.append(f"{command}\n    {error.message}")
    return wrong


SHELL = [
    command
    for page in PAGES
    for block in blocks(page)
    if block.language == "sh"
    for command in commands(block.text, block.place)
]
"""The commands of all blocks."""


def test_every_command_of_a_block_is_understood(places, monkeypatch):
    monkeypatch.chdir(places)
    assert len(SHELL) > 60
    wrong = lies(SHELL)
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "line",
    [
        "gsfw trian method=3dgs",
        "gsfw train method=3dgs stratgy=mcmc",
        "gsfw train method=3dgs strategy.cap_max=2",
        "gsfw train method=3dgs strategy=mcmc strategy.cap_max=many",
        "gsfw train method=3dgs data=nowhere",
        "gsfw render RUN chanel=depth",
        "gsfw runs sort=size",
        "gsfw prepare photos out=scene train=true steps=few",
        "gsfw check DIR imagse=all",
        "gsfw resume latest sh_degree=1",
        "gsfw tradeoff data=DIR budget.minuts=3",
        "X=1 gsfw eval latest data=DIR &&  gsfw eval latst=1 > file # a comment isn't read",
    ],
)
def test_a_wrong_command_is_found(line, places, monkeypatch):
    monkeypatch.chdir(places)
    assert len(lies(commands(line, "a page"))) == 1


def test_every_command_within_a_sentence_is_understood(places, monkeypatch):
    monkeypatch.chdir(places)
    # The page of reliability is a record of what campaigns ran in folders of their own.
    pages = [page for page in PAGES if page.name != "reliability.md"]
    found = [completed(command) for page in pages for command in spans(page)]
    assert len(found) > 40
    wrong = lies(found)
    assert not wrong, "\n".join(wrong)


def test_every_example_in_the_help_of_a_verb_is_understood(places, monkeypatch):
    monkeypatch.chdir(places)
    found = []
    for verb, run in load_all("command", installed()).items():
        with pytest.raises(HelpRequested) as wanted:
            run(["--help"])
        lines = str(wanted.value).partition("examples:\n")[2]
        found += commands(lines, f"gsfw {verb} --help")
    assert len(found) > 40
    wrong = lies(found)
    assert not wrong, "\n".join(wrong)


def test_blocks_of_shell_code_name_programs_that_are_there():
    unknown = [
        str(command)
        for command in SHELL
        if command.words[0] not in OTHERS | {"gsfw"}
        or ("/" in command.words[0] and not (ROOT / command.words[0]).is_file())
    ]
    assert not unknown


def test_a_block_with_a_command_of_gsfw_says_that_it_is_shell_code():
    """Blocks of the language "console" need parts or files that the reader has made."""
    wrong = [
        block.place
        for page in PAGES
        for block in blocks(page)
        if block.language not in ("sh", "console") and block.text.startswith("gsfw ")
    ]
    assert not wrong


def test_blocks_of_python_code_are_python():
    for page in PAGES:
        for block in blocks(page):
            if block.language == "python":
                ast.parse(block.text, filename=block.place)
