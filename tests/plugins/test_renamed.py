"""Settings that were renamed: old command lines, files and runs open."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

import pytest
from support.fake_parts import Demo, FakePlugin, Grow, registry_of

from gsfw.core.errors import ConfigError
from gsfw.plugins.config_file import read_config, write_config
from gsfw.plugins.keys import current_key
from gsfw.plugins.registry import installed
from gsfw.plugins.settings import COMMAND_LINE, Layer, Settings, resolve
from gsfw.plugins.specs import Spec, hookimpl


@dataclass
class Inner:
    renamed: ClassVar[Mapping[str, str]] = {"strength": "weight"}

    weight: float = 1.0
    """How strongly."""


@dataclass
class NewDemo(Demo):
    renamed: ClassVar[Mapping[str, str]] = {
        "edges": "border", "border": "mode",  # Renamed twice.
        "inside": "inner", "gone": "",
        "mode=firm": "mode=hard",
    }  # fmt: skip

    inner: Inner = field(default_factory=Inner)


@dataclass
class NewGrow(Grow):
    renamed: ClassVar[Mapping[str, str]] = {"interval": "every"}


class Plugin(FakePlugin):
    def spec(self, name: str, kind: type) -> Spec:
        new = {Demo: NewDemo, Grow: NewGrow}.get(kind)
        return Spec(name, "", f"{__name__}:{new.__name__}") if new else super().spec(name, kind)

    @hookimpl
    def gsfw_methods(self):
        return [self.spec("demo", Demo)]


def settings(*layers: Layer, **typed: str) -> Settings:
    return resolve(registry_of(Plugin()), [*layers, Layer(COMMAND_LINE, typed)])


def test_old_names_on_the_command_line_work_with_a_note():
    old = {"inside.strength": "2", "strategy.interval": "7"}
    found = settings(method="demo", edges="hard", gone="3", **old)
    values = found.flat()
    assert (values["mode"], values["inner.weight"], values["strategy.every"]) == ("hard", 2.0, 7)
    assert found.notes == (
        "edges was renamed to mode.",
        "gone has no effect any more.",
        "inside.strength was renamed to inner.weight.",
        "strategy.interval was renamed to strategy.every.",
    )
    assert found.sources["mode"] == COMMAND_LINE
    assert "strategy.every" in found.given


@pytest.mark.parametrize("everything", [True, False])
def test_a_run_with_old_names_opens_silently(tmp_path, everything):
    path = tmp_path / "config.yaml"
    text = write_config(settings(method="demo", mode="hard", **{"strategy.every": "7"}), ["train"])
    text = text.replace("strategy.every", "strategy.interval").replace("mode", "edges")
    path.write_text(text + "gone: 3\n")
    found = settings(read_config(path, everything=everything))
    assert (found.flat()["mode"], found.flat()["strategy.every"]) == ("hard", 7)
    assert {"mode", "strategy.every"} <= set(found.given)
    assert found.notes == ()


def test_an_old_value_on_the_command_line_works_with_a_note():
    found = settings(method="demo", edges="firm")
    assert found.flat()["mode"] == "hard"
    assert found.notes == ("edges was renamed to mode.", "mode=firm was renamed to mode=hard.")


@pytest.mark.parametrize("everything", [True, False])
def test_a_run_with_an_old_value_opens_silently(tmp_path, everything):
    path = tmp_path / "config.yaml"
    text = write_config(settings(method="demo", mode="hard"), ["train"])
    path.write_text(text.replace("mode: hard", "mode: firm"))
    found = settings(read_config(path, everything=everything))
    assert found.flat()["mode"] == "hard"
    assert "mode" in found.given
    assert found.notes == ()


@pytest.mark.parametrize("method", ["3dgs", "4dgs", "4d-rotor", "spacetime", "dynamic3dgs"])
def test_sh_same_of_old_runs_is_uniform(method):
    old = Layer("config.yaml of an old run", {"method": method, "sh": "same"})
    assert resolve(installed(), [old]).flat()["sh"] == "uniform"


def test_a_setting_under_both_names_is_refused():
    with pytest.raises(ConfigError) as caught:
        settings(method="demo", edges="hard", mode="soft")
    assert str(caught.value) == ("edges was renamed to mode, and both are given.\nLeave out edges.")


def test_names_that_go_round_in_a_circle_end():
    assert current_key("a", {"a": "b", "b": "a"}) in ("a", "b")
    assert current_key("a.c", {"a": ""}) == ""
