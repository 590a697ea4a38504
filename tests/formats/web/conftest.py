"""Fixtures of the tests of web pages."""

import pytest


@pytest.fixture
def page(browser):
    """A page of 480 x 360 pixels."""
    opened = browser.open(size=(480, 360))
    yield opened
    opened.close()
