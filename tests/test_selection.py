"""The tests that a command selects."""

from pathlib import Path
from types import SimpleNamespace

import pytest


@pytest.mark.parametrize(
    ("arguments", "markers", "selected"),
    [
        ((), "", "not slow"),
        (("tests/core",), "", "not slow"),
        (("-m", ""), "", ""),
        (("-m=",), "", ""),
        (("-m", "slow"), "slow", "slow"),
        (("tests/test_install.py::test_it",), "", ""),
    ],
)
def test_slow_tests_are_left_out_unless_markers_or_a_test_are_named(
    arguments, markers, selected, request
):
    conftest = request.config.pluginmanager.get_plugin(str(Path(__file__).with_name("conftest.py")))
    option = SimpleNamespace(markexpr=markers)
    config = SimpleNamespace(invocation_params=SimpleNamespace(args=arguments), option=option)
    conftest.pytest_configure(config)
    assert option.markexpr == selected
