"""What cameras look at, the sides they look from, and which way is up."""

import numpy as np
import pytest
from support.checked_captures import ball, looking_at, write_ball

from gsfw.preparation.check.coverage import looked_at, widest_gap
from gsfw.preparation.check.up_axis import up_axis

UP = np.array([0.0, 0.0, 1.0])


def ring(count: int, degrees: float = 360.0) -> tuple[np.ndarray, np.ndarray]:
    """Positions and axes of cameras that look down at the origin."""
    angles = np.radians(np.arange(count) * degrees / count)
    centers = np.stack([np.cos(angles), np.sin(angles), np.full(count, 0.8)], axis=1)
    return centers, np.stack([looking_at(center, np.zeros(3))[2, :3] for center in centers])


def test_the_gap_is_around_what_cameras_look_at_and_not_around_the_points():
    centers, axes = ring(24)
    middle = looked_at(centers, axes)
    np.testing.assert_allclose(middle, 0, atol=1e-6)
    assert widest_gap(centers, middle, UP) == pytest.approx(15)
    # Around a point far behind, as the middle of a background is, nearly all would be open.
    assert widest_gap(centers, np.array([0.0, 3.0, 0.0]), UP) > 230


def test_a_few_cameras_that_look_elsewhere_do_not_move_it():
    centers, axes = ring(24)
    axes[3], axes[17] = [0, 0, 1], [0.6, 0.8, 0]
    np.testing.assert_allclose(looked_at(centers, axes), 0, atol=0.02)


def test_cameras_that_look_outward_look_at_nothing():
    centers, axes = ring(24)
    assert looked_at(centers, -axes) is None


@pytest.mark.slow
def test_up_is_across_the_cameras_also_on_a_part_of_a_ring_that_looks_down(tmp_path):
    angles = np.radians(np.linspace(0, 130, 24))
    centers = np.stack([np.cos(angles), np.sin(angles), np.full(24, 0.9)], axis=1)
    survey = write_ball(tmp_path / "a", ball(centers)).survey(1)
    up, how = up_axis(survey.scene, survey.viewpoints)
    world = survey.scene.world_from_scene.rotation.numpy() @ up
    # The mean of the cameras' own up vectors is off by 20 degrees here.
    np.testing.assert_allclose(world, UP, atol=0.02)
    assert how == "up as the cameras are held"
