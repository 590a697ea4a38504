"""Fixtures of the studies' tests."""

from small_study import quick  # noqa: F401 - a fixture
