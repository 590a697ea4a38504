"""Fixtures of the studies' tests."""

from support.small_study import quick  # noqa: F401 - a fixture
