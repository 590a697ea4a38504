"""Fixtures of the tests of plugins."""

from support.plugin_files import plugin_path  # noqa: F401 - a fixture
