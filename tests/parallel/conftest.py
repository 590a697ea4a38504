"""Fixtures of tests with several processes."""

from support.plugin_files import plugin_path  # noqa: F401 - a fixture
