"""Tests of gsfw.plugins.plugin_path: plugins that are not installed."""

import sys
from importlib import metadata
from pathlib import Path

import pytest
from support.fake_parts import FakePlugin, registry_of
from support.plugin_files import HEAD, hook

from gsfw.core.errors import ConfigError
from gsfw.plugins.config_file import read_config, write_config
from gsfw.plugins.discovery import Discovery, PluginSource
from gsfw.plugins.registry import Registry, installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, resolve

SAMPLERS = "[Spec(NAME, '', f'{__name__}:Part')]"
PROJECT_FILE = '[project.entry-points.gsfw]\nmy-entry = "tree_plugin.hooks"\n'


def module(path: Path, name: str, more: str = "") -> Path:
    """Write a module with one sampler."""
    path.parent.mkdir(parents=True, exist_ok=True)
    answer = SAMPLERS.replace("NAME", repr(name))
    path.write_text(f"{HEAD}{more}\n{hook('gsfw_samplers', f'return {answer}')}class Part: pass\n")
    return path


def reasons() -> list[str]:
    return [f"{item.name}: {item.reason}. {item.advice}" for item in installed().broken]


def test_a_file_is_a_plugin_named_by_its_place_and_may_import_its_neighbours(
    plugin_path,
    tmp_path,
):
    (tmp_path / "neighbour_of_plugin.py").write_text("VALUE = 3\n")
    file = module(tmp_path / "file_plugin.py", "mine", "import neighbour_of_plugin")
    plugin_path(file)
    spec = installed().find("sampler", "mine")
    assert (spec.distribution, spec.version) == (f"from {file}", "")
    assert spec.load() is sys.modules["file_plugin"].Part
    assert reasons() == []
    owner = installed().owner("file_plugin")
    assert owner is not None
    assert owner.noun == str(file)


def test_the_folder_of_a_package_is_a_plugin_with_its_relative_imports(
    plugin_path,
    tmp_path,
):
    (tmp_path / "folder_plugin").mkdir()
    (tmp_path / "folder_plugin" / "inner.py").write_text("VALUE = 3\n")
    module(tmp_path / "folder_plugin" / "__init__.py", "mine", "from .inner import VALUE")
    plugin_path(tmp_path / "folder_plugin", tmp_path / "folder_plugin" / ".." / "folder_plugin")
    assert installed().find("sampler", "mine").load().__module__ == "folder_plugin"
    assert reasons() == []


@pytest.mark.parametrize("inner", ["src", "."])
def test_a_source_tree_replaces_the_installed_package(
    plugin_path,
    tmp_path,
    monkeypatch,
    inner,
):
    (tmp_path / "pyproject.toml").write_text(PROJECT_FILE)
    module(tmp_path / inner / "tree_plugin" / "hooks.py", "mine")
    old = metadata.EntryPoint("my-entry", "tree_plugin.hooks", "gsfw")
    monkeypatch.setattr(metadata, "entry_points", lambda group: [old])
    plugin_path(tmp_path)
    spec = installed().find("sampler", "mine")
    assert spec.distribution == f"from {tmp_path}"
    assert spec.load().__module__ == "tree_plugin.hooks"
    assert reasons() == []


def test_what_is_no_plugin_is_named_and_the_others_work(plugin_path, tmp_path):
    for name, text in {"empty": "[project]\n", "odd": "[", "missing": PROJECT_FILE}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "pyproject.toml").write_text(text)
    (tmp_path / "nothing").mkdir()
    files = {name: module(tmp_path / f"{name}.py", name) for name in ("json", "two-words", "good")}
    names = ("empty", "odd", "missing", "nothing", "gone")
    plugin_path(*(tmp_path / name for name in names), *files.values())
    assert "good" in installed().slot("sampler")
    said = reasons()
    assert said[0] == (
        "empty: pyproject.toml has no [project.entry-points.gsfw]. Correct GSFW_PLUGIN_PATH."
    )
    for line, text in zip(
        said[1:],
        (
            "odd: pyproject.toml cannot be read: Invalid",
            "my-entry: ModuleNotFoundError: No module named 'tree_plugin'. Install what it needs, "
            f"or take {tmp_path / 'missing'} out of GSFW_PLUGIN_PATH.",
            "nothing: it is no .py file, no package with __init__.py and no source tree",
            "gone: there is no such file or folder",
            "json: ImportError: another module is named 'json': rename this one",
            "two-words.py: 'two-words' is no name of a module",
        ),
        strict=True,
    ):
        assert line.startswith(text)


def test_nothing_is_loaded_where_plugins_are_disabled(
    plugin_path,
    tmp_path,
    monkeypatch,
):
    monkeypatch.setenv("GSFW_DISABLE_PLUGINS", "1")
    plugin_path(module(tmp_path / "disabled_plugin.py", "mine"), tmp_path / "gone")
    assert "mine" not in installed().slot("sampler")
    assert reasons() == []


def test_a_run_records_the_place_and_names_it_where_it_is_missing(tmp_path):
    discovery = Discovery()
    discovery.add(FakePlugin(), PluginSource("mine", f"from {tmp_path}/mine.py", ""))
    settings = resolve(Registry(discovery), [Layer(COMMAND_LINE, {"method": "demo"})])
    file = tmp_path / "config.yaml"
    file.write_text(write_config(settings, []))
    assert f"plugins:\n- from {tmp_path}/mine.py\n" in file.read_text()
    with pytest.raises(ConfigError) as caught:
        resolve(registry_of(), [read_config(file)])
    assert str(caught.value) == (
        "no method 'demo' is installed here. The run was made with "
        f"{tmp_path}/mine.py.\n"
        f"Name the place where it is now: GSFW_PLUGIN_PATH={tmp_path}/mine.py"
    )


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('project="x"', "in pyproject.toml, project is 'x': expected a table"),
        ("[project]\nentry-points=3", "in pyproject.toml, project.entry-points is 3: expected a"),
        (
            '[project.entry-points]\ngsfw="x"',
            "in pyproject.toml, project.entry-points.gsfw is 'x': expected a table",
        ),
        ("[project.entry-points.gsfw]\nmine=3", "in pyproject.toml, entry point 'mine' is 3: exp"),
    ],
)
def test_a_project_file_of_another_form_is_named_and_breaks_nothing(
    plugin_path, tmp_path, text, reason
):
    (tmp_path / "pyproject.toml").write_text(text)
    plugin_path(tmp_path)
    assert installed().slot("method")
    (said,) = reasons()
    assert reason in said
