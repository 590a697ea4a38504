"""Every kind of broken plugin is one line in `gsfw plugins` and `gsfw doctor`, and harms nobody."""

import json
from pathlib import Path

import pytest
from support.plugin_files import HEAD, hook

from gsfw.commands.main import main


def spec(name: str, target: str) -> str:
    return f"return [Spec({name!r}, '', f'{target}')]"


SETTINGS = HEAD + "from gsfw.api import Callback, Metric, StrategyConfig\n\n"

FAULTS = {
    "plugin_without_library": (
        "import a_library_that_nobody_has\n",
        "plugin 'plugin_without_library' is skipped: ModuleNotFoundError: No module named "
        "'a_library_that_nobody_has'. Install what it needs, or ",
    ),
    "plugin_for_old_gsfw": (
        "from gsfw.core.strategy import DensityStrategy\n",
        "plugin 'plugin_for_old_gsfw' is skipped: ModuleNotFoundError: No module named "
        "'gsfw.core.strategy'. This is gsfw 0.1.0: change the plugin, or ",
    ),
    "plugin_with_old_name": (
        "from gsfw.api import Fridge\n",
        "plugin 'plugin_with_old_name' is skipped: ImportError: cannot import name 'Fridge' from "
        "'gsfw.api' ",
    ),
    "plugin_that_exits": (
        "raise SystemExit('no licence')\n",
        "plugin 'plugin_that_exits' is skipped: SystemExit: no licence. This is gsfw 0.1.0: ",
    ),
    "plugin_that_is_no_python": (
        "def f(:\n",
        "plugin 'plugin_that_is_no_python' is skipped: SyntaxError: ",
    ),
    "plugin_for_newer_api": (
        HEAD + hook("gsfw_requires_api", "return '>=7'"),
        "plugin 'plugin_for_newer_api' is skipped: it asks for gsfw.api >=7, and gsfw 0.1.0 has ",
    ),
    "plugin_of_newer_spec": (
        HEAD + hook("gsfw_methods", "return [Spec('a', '', 'b:C', api_version=3)]"),
        "hook 'gsfw_methods' is skipped: it registers a Spec with the field 'api_version', ",
    ),
    "plugin_with_taken_name": (
        HEAD + hook("gsfw_methods", spec("3dgs", "b:C")),
        "method '3dgs' is skipped: this name is taken by gsfw 0.1.0. The built-in one is used; ",
    ),
    "plugin_with_unknown_hook": (
        HEAD + hook("gsfw_strategy", "return []"),
        "hook 'gsfw_strategy' is skipped: there is no such hook (did you mean 'gsfw_strategies'?), "
        "the others are used. ",
    ),
    "plugin_with_arguments": (
        HEAD + "@hookimpl\ndef gsfw_samplers(registry):\n    return []\n",
        "plugin 'plugin_with_arguments' is skipped: gsfw_samplers takes no arguments. Write def "
        "gsfw_samplers().",
    ),
    "plugin_without_mark": (
        HEAD + "def gsfw_methods():\n    return []\n",
        "hook 'gsfw_methods' is skipped: it is not marked as a hook. Write @hookimpl above "
        "gsfw_methods.",
    ),
    "plugin_without_list": (
        HEAD + hook("gsfw_samplers", "return None"),
        "hook 'gsfw_samplers' is skipped: it returned NoneType, expected a list of Spec. ",
    ),
    "plugin_that_raises": (
        HEAD + hook("gsfw_exporters", "raise OSError('no network')"),
        "hook 'gsfw_exporters' is skipped: it raised OSError: no network. ",
    ),
    "plugin_without_target": (
        HEAD + hook("gsfw_strategies", spec("lost", "{__name__}:Lost")),
        "strategy 'lost' is skipped: AttributeError: module 'plugin_without_target' has no "
        "attribute 'Lost'. This is gsfw 0.1.0: ",
    ),
    "plugin_without_dataclass": (
        SETTINGS + hook("gsfw_strategies", spec("plain", "{__name__}:Plain"))
        + "class Plain(StrategyConfig):\n    size: int = 1\n    def refiners(self, scene): ...\n",
        "strategy 'plain' is skipped: Plain is no dataclass, so size is no setting: write "
        "@dataclass above it. ",
    ),
    "plugin_of_other_base": (
        SETTINGS + hook("gsfw_callbacks", spec("watch", "{__name__}:Watch"))
        + "class Watch:\n    def on_step(self, report, control): ...\n",
        "callback 'watch' is skipped: its target Watch does not derive from CallbackConfig or "
        "Callback. ",
    ),
    "plugin_of_old_callback": (
        SETTINGS + hook("gsfw_callbacks", spec("old-watch", "{__name__}:Watch"))
        + "class Watch(Callback):\n    def on_step(self, report): ...\n",
        "callback 'old-watch' is skipped: Watch.on_step(self, report) has to take the arguments of "
        "Callback.on_step(self, report, control). ",
    ),
}  # fmt: skip
"""Source of each broken plugin, and the start of its line, without its place."""

SOUND = (
    HEAD
    + hook("gsfw_requires_api", "return '>=1.0,<2'")
    + hook("gsfw_metrics", spec("darkness", "{__name__}:Darkness"))
    + "from gsfw.api import Metric\n\nclass Darkness(Metric):\n"
    + "    def __call__(self, rendered, target, valid): return 1 - float(rendered.mean())\n"
)


@pytest.fixture
def broken(plugin_path, tmp_path) -> dict[str, str]:
    """The expected line of each broken plugin; all are on the path, and a sound one."""
    sources = {name: source for name, (source, _) in FAULTS.items()} | {"sound_plugin": SOUND}
    files = [tmp_path / f"{name}.py" for name in sources]
    for file in files:
        file.write_text(sources[file.stem])
    plugin_path(*files)
    return {
        name: line.replace(" is skipped", f" (from {tmp_path / name}.py) is skipped", 1)
        for name, (_, line) in FAULTS.items()
    }


def test_every_fault_is_one_line_of_plugins_and_of_doctor(broken, capsys):
    assert main(["plugins", "slot=metric"]) == 0
    said = capsys.readouterr().out.splitlines()
    lines = [line for line in said if " is skipped: " in line]
    for line in broken.values():
        assert len([text for text in lines if text.startswith(line)]) == 1, line
    assert len(lines) == len(broken)
    sound = next(line for line in said if "darkness" in line)
    assert ">=1.0,<2" in sound
    assert "  ok" in sound
    assert main(["doctor", "json=true"]) == 0
    found = json.loads(capsys.readouterr().out)["findings"]
    whole = [f"{item['what']}: {item['details']}" for item in found]
    for line in broken.values():
        reason = line.partition(" is skipped: ")[2]
        assert len([text for text in whole if f".py): {reason}" in text]) == 1, line


def test_what_is_skipped_is_told_before_other_verbs_and_they_work(broken, capsys, finished_run):
    assert main(["info", str(finished_run), "json=true"]) == 0
    told = capsys.readouterr()
    assert json.loads(told.out)
    warnings = told.err.splitlines()
    assert all(line.startswith("warning: ") for line in warnings)
    assert len(set(warnings)) == len(warnings)
    at_import = ("plugin_without_library", "plugin_for_newer_api", "plugin_with_unknown_hook")
    for name in at_import:
        assert any(broken[name] in line for line in warnings)


def test_a_run_that_is_opened_without_its_plugin_names_the_file(
    plugin_path, tmp_path, capsys, finished_run
):
    """For the verbs that open runs; those that open model files and configurations do the same."""
    text = (finished_run / "config.yaml").read_text()
    run = tmp_path / "run"
    (run / "checkpoints").mkdir(parents=True)
    for file in Path(finished_run, "checkpoints").iterdir():
        (run / "checkpoints" / file.name).symlink_to(file)
    old = "plugins: []", "strategy: adc\n"
    assert all(part in text for part in old)
    text = text.replace(old[0], "plugins:\n- gsfw-dots 0.3").replace(old[1], "strategy: dots\n")
    (run / "config.yaml").write_text(text.replace("given:", "given:\n- strategy", 1))
    for arguments in (
        ["eval", str(run)],
        ["render", str(run)],
        ["export", str(run)],
        ["view", str(run)],
        ["resume", str(run), "steps=30"],
        ["train", f"config={run / 'config.yaml'}", f"out={tmp_path / 'new'}"],
    ):
        assert main(arguments) == 2
        assert capsys.readouterr().err.endswith(
            "error: no strategy 'dots' is installed here. The run was made with gsfw-dots 0.3.\n"
            "Install it, if you trust it: pip install gsfw-dots==0.3\n"
        ), arguments
