"""Former names of gsfw.api work, with one warning each."""

import subprocess
import sys

import pytest
from packaging.version import Version

from gsfw import api
from gsfw.api.deprecation import DEPRECATED


@pytest.mark.parametrize("name", DEPRECATED)
def test_a_former_name_is_the_new_one_with_a_warning_of_replacement_and_versions(name):
    known = DEPRECATED[name]
    with pytest.warns(DeprecationWarning, match=name) as caught:
        assert getattr(api, name) is getattr(api, known.replacement)
    assert str(caught[0].message) == (
        f"gsfw.api.{name} is now gsfw.api.{known.replacement}, since API version {known.since}; "
        f"version {known.removed} removes the former name."
    )


def run(code: str) -> subprocess.CompletedProcess[str]:
    """Run a program that is not under the import hook of the tests."""
    command = [sys.executable, "-W", "always", "-c", code]
    return subprocess.run(command, capture_output=True, text=True, check=True)


def test_an_import_of_a_former_name_warns_once_and_at_the_line_of_the_plugin():
    found = run(
        "from gsfw.api.deprecation import DEPRECATED, Deprecated\n"
        "DEPRECATED['Former'] = Deprecated('ConfigError', '1.0', '2.0')\n"
        "from gsfw.api import ConfigError, Former\n"
        "print(Former is ConfigError)"
    )
    assert found.stdout == "True\n"
    assert found.stderr.startswith("<string>:3: DeprecationWarning: gsfw.api.Former is now ")
    assert found.stderr.count("DeprecationWarning") == 1


def test_former_names_go_when_their_version_comes():
    for name, known in DEPRECATED.items():
        assert Version(known.since) <= Version(api.API_VERSION) < Version(known.removed), name
        assert Version(known.removed).release[1:] in ((), (0,)), "removed by a new first number"
        assert name not in dir(api)


def test_registration_errors_progress_and_configurations_need_no_torch():
    code = (
        "import sys\n"
        "from gsfw.api import API_VERSION, ConfigError, Feature, MethodConfig, Needs, Spec, "
        "hookimpl, number, stage, steps_field\n"
        "print(sorted({'torch', 'numpy'} & set(sys.modules)))"
    )
    assert run(code).stdout == "[]\n"
