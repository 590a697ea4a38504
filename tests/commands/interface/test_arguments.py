"""Tests of gsfw.commands.interface.arguments."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import pytest

from gsfw.commands.interface.arguments import (
    HelpRequested,
    Options,
    layers,
    parse,
    positional,
    read_options,
)
from gsfw.core.errors import ConfigError
from gsfw.core.ranges import number


@dataclass(kw_only=True)
class DrawOptions(Options):
    """Draw a run."""

    examples: ClassVar[tuple[str, ...]] = ("gsfw draw latest",)

    run: str = positional("RUN")
    """A run folder."""
    target: str = positional("FILE", default="")
    """Where to."""
    split: Literal["eval", "train"] = "eval"
    """Which pictures."""
    frames: int = number(60, at_least=1)
    """How many."""


def refusal(*tokens: str) -> str:
    with pytest.raises(ConfigError) as caught:
        read_options("draw", DrawOptions, tokens)
    return str(caught.value)


def test_keys_and_values_may_be_written_in_three_ways_and_in_any_order():
    expected = {"method": "3dgs", "optim.means_lr": "1e-4", "seed": "-3"}
    for tokens in (
        ["method=3dgs", "optim.means_lr=1e-4", "seed=-3"],
        ["--seed", "-3", "--method", "3dgs", "--optim.means_lr", "1e-4"],
        ["--optim.means-lr=1e-4", "--seed=-3", "method=3dgs"],
    ):
        assert parse(tokens).values == expected


def test_values_may_hold_equal_signs_spaces_dashes_and_nothing():
    values = parse(["data=/a=b/c d", "out=-x", "init=", "--note", "two words=here"]).values
    assert values == {"data": "/a=b/c d", "out": "-x", "init": "", "note": "two words=here"}


def test_after_two_dashes_all_are_words():
    found = parse(["a.png", "out=o", "--", "-x.png", "b=c.png", "--", "--help"])
    assert found.words == ("a.png", "-x.png", "b=c.png", "--", "--help")
    assert found.values == {"out": "o"}


def test_of_a_key_given_twice_the_last_wins():
    assert parse(["seed=1", "--seed", "2", "seed=3"]).values == {"seed": "3"}


def test_the_home_folder_is_expanded_as_shells_do_elsewhere(monkeypatch):
    monkeypatch.setenv("HOME", "/home/me")
    assert parse(["data=~/garden", "out=~x"]).values == {"data": "/home/me/garden", "out": "~x"}


def test_flags_need_no_value():
    arguments = parse(["--json", "--dry-run", "latest", "-h"])
    assert arguments.words == ("latest",)
    assert all(arguments.flag(name) for name in ("json", "dry_run", "help"))
    assert not parse([]).flag("json")
    assert not parse(["json=false"]).flag("json")
    with pytest.raises(ConfigError, match="json=2: expected true or false, found '2'"):
        parse(["json=2"]).flag("json")


def test_an_option_without_its_value_is_explained():
    for tokens in (["--steps"], ["--steps", "--json"]):
        with pytest.raises(ConfigError) as caught:
            parse(tokens)
        assert str(caught.value) == "--steps: a value is missing.\nWrite steps=VALUE."


def test_config_files_come_before_what_is_typed(tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.yaml").write_text(f"seed: {name}\n")
    tokens = [f"config={tmp_path}/b.yaml", "seed=1", "--json", f"config={tmp_path}/a.yaml"]
    found = layers(parse(tokens))
    assert [layer.values for layer in found] == [{"seed": "b"}, {"seed": "a"}, {"seed": "1"}]
    assert found[0].source == f"config file {tmp_path}/b.yaml"
    assert found[2].source == "command line"


def test_options_are_read_by_type_and_words_by_place():
    options = read_options("draw", DrawOptions, ["frames=3", "latest", "split=train", "--json"])
    assert options == DrawOptions(run="latest", frames=3, split="train", json=True)
    assert read_options("draw", DrawOptions, ["latest", "a.png"]).target == "a.png"


def test_each_mistake_in_options_has_its_message():
    assert refusal() == "gsfw draw: RUN is missing.\nSee gsfw draw --help."
    assert refusal("a", "b", "c") == "gsfw draw: unexpected 'c'.\nSee gsfw draw --help."
    assert refusal("a", "b", "frames") == (
        "gsfw draw: frames is given without a value.\nWrite frames=VALUE."
    )
    assert refusal("a", "frame=3") == (
        "gsfw draw: unknown key 'frame'. Did you mean 'frames'?\nAll keys: gsfw draw --help"
    )
    assert refusal("a", "split=test") == (
        "split=test: expected one of eval, train, found 'test'.\nsplit: Which pictures."
    )
    assert refusal("a", "frames=0") == "frames=0: expected a number of at least 1."


def test_help_shows_usage_words_keys_and_examples():
    with pytest.raises(HelpRequested) as caught:
        read_options("draw", DrawOptions, ["--help"])
    lines = [" ".join(line.split()) for line in str(caught.value).splitlines()]
    assert lines == [
        "usage: gsfw draw RUN FILE [key=value ...]",
        "",
        "Draw a run.",
        "",
        "RUN A run folder.",
        "FILE Where to.",
        "split=eval one of eval, train Which pictures.",
        "frames=60 whole number How many.",
        "json=false true or false Print one JSON document on standard output, and nothing else"
        " there.",
        "debug=false true or false Show the traceback of an error.",
        "",
        "examples:",
        "gsfw draw latest",
    ]
