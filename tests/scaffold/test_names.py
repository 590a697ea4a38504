"""Tests of gsfw.scaffold.names."""

import pytest

from gsfw.core.errors import ConfigError
from gsfw.plugins.registry import installed
from gsfw.scaffold.names import check_name


def test_a_name_has_three_spellings():
    name = check_name("a-test", "method", installed())
    assert (name.dashed, name.module, name.camel) == ("a-test", "a_test", "ATest")


def test_a_module_never_begins_with_a_digit():
    name = check_name("5dgs", "method", installed())
    assert (name.module, name.camel) == ("gsfw_5dgs", "Gsfw5dgs")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("My_Method", "'My_Method' cannot be the name of a package.\n.* such as my-method."),
        ("a" * 31, "cannot be the name of a package.\nUse at most 30 small letters"),
        ("../evil", "cannot be the name of a package.\n.* such as evil."),
        ("3dgs", "there is a method '3dgs' already, of gsfw 0.1.0."),
        ("class", "'class' is a keyword of Python.\nChoose another name: my-class."),
        ("none", "'none' is a keyword of Python."),
        ("json", "a module 'json' exists here already"),
        ("tests", "a module 'tests' exists here already"),
    ],
)
def test_a_name_that_cannot_be_used_is_refused_with_the_cause(text, message):
    with pytest.raises(ConfigError, match=message):
        check_name(text, "method", installed())
