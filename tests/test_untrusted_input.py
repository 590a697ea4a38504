"""What files hold is data: no call of the package runs what it reads.

Calls are found in the syntax trees of all sources, by the names that they are written with.
"""

import ast
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
APART = {"tests", "benchmarks", "campaigns", "website", "docs", "examples", "site", "build", "runs"}
"""Folders at the root that are no part of the package."""

PICKLES = {"jobs/call.py", "jobs/process.py"}
"""Calls of functions on their way to a process of this user, in a folder that it alone may read."""
LOADS_FOR_SCRIPTS = {"compat/cuda_on_cpu.py"}
"""torch.load as a script of the user's own calls it."""
SERVES, ASKS = {"viewer/server.py"}, {"jobs/ray/cluster.py"}
"""Modules with a socket of their own: the page's, and the question whether a cluster answers."""
STARTS = {
    *("formats/usd/importer.py", "jobs/guard.py", "jobs/process.py"),
    "preparation/mapping/global_mapping.py",
    *("studies/bench/first_use.py", "studies/origin.py", "testing/everywhere.py"),
}
"""Modules that start programs: Python itself and git, never one with a name from a data set."""
SAFE_LOADERS = {"LOADER", "_Loader"}
"""Names of loaders that derive from PyYAML's safe one (the second test)."""

SUSPECT = re.compile(
    r"eval|exec|os\.(system|popen)|mktemp|marshal|shell|subprocess|spawn|pickle|load|extract|url|request|http|socket"
)
"""Words without one of which a source need not be parsed, which takes most of the time."""


def sources() -> Iterator[Path]:
    for folder in sorted(ROOT.iterdir()):
        if folder.is_dir() and folder.name[0] not in "._" and folder.name not in APART:
            yield from sorted(folder.rglob("*.py"))


@dataclass(frozen=True)
class Call:
    """A call as it is written: its name with dots, keywords and arguments."""

    name: str
    keywords: dict[str, str]
    arguments: list[str]

    @property
    def last(self) -> str:
        return self.name.rpartition(".")[2]

    def gives(self, keyword: str, value: str) -> bool:
        return self.keywords.get(keyword) == value


def calls(text: str) -> Iterator[Call]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call):
            keywords = {word.arg or "**": ast.unparse(word.value) for word in node.keywords}
            yield Call(ast.unparse(node.func), keywords, [ast.unparse(item) for item in node.args])


def loads_yaml_unsafely(call: Call, place: str) -> bool:
    loader = call.keywords.get("Loader", "".join(call.arguments[1:2]))
    return call.name in ("yaml.load", "yaml.load_all") and loader not in SAFE_LOADERS


RUNS_TEXT = ("eval", "exec", "os.system", "os.popen", "marshal.loads")
RULES: dict[str, Callable[[Call, str], bool]] = {
    "runs a text": lambda call, place: call.name in RUNS_TEXT,
    "has a name that others can guess": lambda call, place: call.name == "tempfile.mktemp",
    "asks a shell": lambda call, place: (
        "shell" in call.keywords and not call.gives("shell", "False")
    ),
    "reads a pickle": lambda call, place: (
        call.name.startswith(("pickle.load", "pickle.Unpickler")) and place not in PICKLES
    ),
    "has no weights_only=True": lambda call, place: (
        call.name == "torch.load" and not call.gives("weights_only", "True")
    ),
    "has no allow_pickle=False": lambda call, place: (
        call.name in ("np.load", "numpy.load") and not call.gives("allow_pickle", "False")
    ),
    "starts a program": lambda call, place: (
        call.name.startswith(("subprocess.", "os.spawn", "os.exec")) and place not in STARTS
    ),
    "has no safe loader": loads_yaml_unsafely,
    "has no filter='data'": lambda call, place: (
        call.last in ("extractall", "extract") and not call.gives("filter", "'data'")
    ),
    "asks a server": lambda call, place: (
        call.last in ("urlopen", "urlretrieve")
        or call.name.startswith(("requests.", "http.client."))
        or (call.name == "socket.create_connection" and place not in ASKS)
    ),
    "may serve others": lambda call, place: (
        call.name in ("socket.socket", "socket.create_server") and place not in SERVES
    ),
}
"""What a call must not do, and what breaks that."""


def faults(text: str, place: str) -> list[str]:
    """Calls of a source that could run what they read, or that reach out."""
    if not SUSPECT.search(text):
        return []
    return [
        f"{place}: {call.name} {what}"
        for call in calls(text)
        for what, breaks in RULES.items()
        if breaks(call, place)
    ]


@pytest.mark.slow
def test_no_call_runs_what_it_reads_or_reaches_out():
    found = []
    for path in sources():
        place = path.relative_to(ROOT).as_posix()
        if place not in LOADS_FOR_SCRIPTS:
            found += faults(path.read_text("utf-8"), place)
    assert not found
    assert {"core", "viewer", "formats"} <= {path.relative_to(ROOT).parts[0] for path in sources()}


@pytest.mark.parametrize(
    "line",
    [
        "eval(text)",
        "start(text, shell=True)",
        "subprocess.run([name])",
        "pickle.loads(file.read())",
        "torch.load(path)",
        "torch.load(path, weights_only=False)",
        "np.load(path)",
        "np.load(path, allow_pickle=True)",
        "yaml.load(text, yaml.Loader)",
        "yaml.load(text, Loader=yaml.UnsafeLoader)",
        "archive.extractall(folder)",
        "tempfile.mktemp()",
        "urllib.request.urlopen(address)",
        "requests.get(address)",
        "socket.create_server(('', 80))",
        "socket.create_connection((host, 80))",
    ],
)
def test_such_a_call_is_found(line):
    assert len(faults(line, "formats/new.py")) == 1


@pytest.mark.parametrize("document", ["!!python/object/apply:os.system [id]", "!!python/name:os.x"])
def test_the_loaders_of_settings_and_studies_make_no_objects(tmp_path, document):
    import yaml

    from gsfw.core.errors import ConfigError
    from gsfw.plugins.config_file import read_config
    from gsfw.studies import study_file

    path = tmp_path / "config.yaml"
    path.write_text(f"settings: {document}\n")
    assert issubclass(study_file._Loader, yaml.SafeLoader)
    with pytest.raises(ConfigError, match="python"):
        read_config(path)


def test_every_test_that_the_threat_model_names_exists():
    page = (ROOT / "docs" / "explain" / "threat-model.md").read_text("utf-8")
    named = set(re.findall(r"`((?:tests|campaigns)/[\w/]+\.py)`", page))
    assert len(named) > 10
    assert not [name for name in named if not (ROOT / name).is_file()]
