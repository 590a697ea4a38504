"""YAML is plain data, and no larger than it looks."""

import pytest
import yaml

from gsfw.core.errors import ConfigError
from gsfw.core.files.yaml_text import FAST_LOADER, parsed_yaml
from gsfw.plugins.config_file import read_config
from gsfw.studies.study_file import read_study

LAUGHS = "a0: &a0 [x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12)
)
MERGED = "a0: &a0 {x: 1}\n" + "".join(
    f"a{n}: &a{n} {{<<: [{', '.join([f'*a{n - 1}'] * 10)}]}}\n" for n in range(1, 12)
)


@pytest.mark.parametrize("loader", [FAST_LOADER, yaml.SafeLoader])
@pytest.mark.parametrize(
    ("text", "words"),
    [
        (LAUGHS, "its aliases make it larger than 100,000 nodes"),
        (MERGED, "its aliases make it larger than 100,000 nodes"),
        ("a: &a [*a]", "nested more than 100 levels deep"),
        ("&a {b: *a}", "nested more than 100 levels deep"),
        ("[" * 20_000, "nested too deeply"),
        ("a: b:\nc: " + "{" * 501, "nested too deeply"),
        ("- " * 150 + "x", "nested more than 100 levels deep"),
        ("when: 2001-99-99", "month must be in"),
        ("count: " + "9" * 5000, "Exceeds the limit"),
        ("a: !!python/object/apply:os.getpid []", "could not determine a constructor"),
        ("a: !!python/name:os.system", "could not determine a constructor"),
        ("{[1]: 2}", "unhashable key"),
    ],
)
def test_what_goes_beyond_the_bounds_is_a_yaml_error(loader, text, words):
    with pytest.raises(yaml.YAMLError, match=words):
        parsed_yaml(text, loader)


def test_whatever_is_within_the_bounds_is_read():
    assert len(parsed_yaml(f"a: '{'[' * 500}'")["a"]) == 500
    assert len(parsed_yaml("a: [" + "[], " * 600 + "]")["a"]) == 600
    assert parsed_yaml("") is None
    assert parsed_yaml("a: &a {b: 1}\nc: {<<: *a, d: [2, null]}") == {
        "a": {"b": 1},
        "c": {"b": 1, "d": [2, None]},
    }


@pytest.mark.parametrize("text", [LAUGHS, MERGED, "a: &a {b: *a}"])
@pytest.mark.parametrize("read", [read_config, read_study])
def test_files_of_settings_are_read_within_these_bounds(tmp_path, read, text):
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="this is not valid YAML") as told:
        read(path)
    assert str(path) in told.value.message
