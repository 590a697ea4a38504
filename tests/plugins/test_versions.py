"""Tests of gsfw.plugins.versions: the range of API versions that a plugin asks for."""

import pytest
from support.fake_parts import FakePlugin, registry_of

from gsfw.core.errors import ConfigError
from gsfw.plugins import versions
from gsfw.plugins.specs import hookimpl


def asking(answer: object) -> FakePlugin:
    """A plugin that asks for these versions."""

    class Asking(FakePlugin):
        @hookimpl
        def gsfw_requires_api(self):
            if isinstance(answer, Exception):
                raise answer
            return answer

    return Asking()


@pytest.fixture(autouse=True)
def version(monkeypatch):
    monkeypatch.setattr(versions, "API_VERSION", "1.4")
    monkeypatch.setattr(versions.metadata, "version", lambda name: "0.7")


@pytest.mark.parametrize(
    "asked", [">=1.0,<2", ">= 1.4", "~=1.2", "==1.*", "<2", "!=1.3", " >=1,<2 "]
)
def test_a_plugin_for_this_version_is_used_and_its_range_known(asked):
    registry = registry_of(asking(asked))
    assert registry.find("strategy", "adc").requires_api == asked
    assert registry.broken == []


def test_a_plugin_that_states_no_range_is_used():
    registry = registry_of(FakePlugin())
    assert registry.find("strategy", "adc").requires_api == ""
    assert registry.broken == []


NEWER = "Install a newer gsfw (pip install --upgrade gsfw), or an older plugin."
OLDER = "Install a newer version of it: pip install --upgrade pkg0"


@pytest.mark.parametrize(
    ("asked", "advice"),
    [
        (">=2.0,<3", NEWER), (">=1.5,<2", NEWER), ("~=1.5", NEWER), ("==2.*", NEWER),
        (">=1.0,<1.3", OLDER), ("<1", OLDER), ("==1.3", OLDER), ("!=1.4", OLDER),
    ],
)  # fmt: skip
def test_a_plugin_for_another_version_is_skipped_with_one_sentence(asked, advice):
    registry = registry_of(asking(asked))
    assert dict(registry.slot("strategy")) == {}
    assert [str(item) for item in registry.broken] == [
        f"plugin 'plugin0' (pkg0 1.0) is skipped: it asks for gsfw.api {asked}, and gsfw 0.7 has "
        f"1.4. {advice}"
    ]


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        ("newest", "its gsfw_requires_api returned 'newest', expected a range such as"),
        (1, "its gsfw_requires_api returned 1, expected a text"),
        (None, "its gsfw_requires_api returned None, expected a text"),
        (["1.0"], "its gsfw_requires_api returned ['1.0'], expected a text"),
        (OSError("no\n  file"), "its gsfw_requires_api raised OSError: no file"),
    ],
)
def test_a_plugin_with_a_range_that_cannot_be_read_is_skipped(answer, reason):
    registry = registry_of(asking(answer), FakePlugin())
    assert registry.find("strategy", "adc").distribution == "pkg1"
    (broken,) = registry.broken
    assert broken.reason.startswith(reason)
    assert "\n" not in str(broken)


def test_a_run_that_needs_a_skipped_plugin_says_why_it_is_skipped():
    registry = registry_of(asking(">=2"))
    with pytest.raises(ConfigError) as caught:
        registry.find("strategy", "adc", ("pkg0 0.9",))
    assert str(caught.value) == (
        "no strategy 'adc' is installed here: the plugin 'plugin0' (pkg0 1.0) is skipped: it asks "
        f"for gsfw.api >=2, and gsfw 0.7 has 1.4.\n{NEWER}"
    )
