"""Aliases of YAML files that stand for more values than anybody can go through."""

import pytest
import yaml

from gsfw.core.errors import ConfigError
from gsfw.core.files.expanded import MOST, check_expanded
from gsfw.plugins.config_file import read_config
from gsfw.studies.study_file import read_study


def bomb(levels: int, opening: str = "{", closing: str = "}") -> str:
    """Levels of nine aliases each."""
    lines = ["a0: &a0 {x: 1}"]
    for level in range(1, levels):
        names = (f"k{k}: *a{level - 1}" if opening == "{" else f"*a{level - 1}" for k in range(9))
        lines.append(f"a{level}: &a{level} {opening}{', '.join(names)}{closing}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("brackets", ["{}", "[]"])
@pytest.mark.parametrize("read", [read_config, read_study])
def test_a_file_of_aliases_of_aliases_is_refused_at_once(tmp_path, read, brackets):
    path = tmp_path / "settings.yaml"
    path.write_text(bomb(40, *brackets))
    with pytest.raises(ConfigError, match=r"its aliases .* a number of values without end") as told:
        read(path)
    assert str(path) in told.value.message


def test_the_number_of_values_is_that_of_the_document_written_out():
    check_expanded("here", yaml.safe_load("{a: &a {x: 1}, b: *a, c: *a}"))
    with pytest.raises(ConfigError, match=r"aliases .* stand for 100,001 values"):
        check_expanded("here", [1] * MOST)


def test_a_document_that_contains_itself_is_refused(tmp_path):
    path = tmp_path / "settings.yaml"
    path.write_text("a: &a {b: *a}\n")
    with pytest.raises(ConfigError, match="without end"):
        read_config(path)


def test_ordinary_aliases_are_read(tmp_path):
    path = tmp_path / "settings.yaml"
    path.write_text("strategy: &s {refine_every: 100}\nother: *s\n")
    assert read_config(path).values["strategy.refine_every"] == 100
