"""The built-in scene, still and moving."""

import pytest
from support.built_in_scene import HERE, small


@pytest.fixture(scope="module")
def static():
    """The scene at rest."""
    return small().build(HERE)


@pytest.fixture(scope="module")
def moving():
    """The scene in motion."""
    return small(moving=True).build(HERE)
