import numpy as np
import pytest

from gsfw.preparation.diagnosis.pair_motion import only_turned

NOISE = 0.5e-3
"""Half a pixel of 1000."""


def turn_by(degrees: float, axis: np.ndarray) -> np.ndarray:
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def only_turns(
    generator: np.random.Generator, view_degrees: float, motion: np.ndarray, noise: float = NOISE
) -> bool:
    """What is said of a pair with this field of view, before the plane of depth 1.

    Args:
        motion: R + t n^T of the camera.
    """
    focal = 0.5 / np.tan(np.radians(view_degrees) / 2)
    matrix = np.diag([focal, focal, 1.0])
    homography = matrix @ motion @ np.linalg.inv(matrix)
    places = generator.uniform((-0.5, -0.375), (0.5, 0.375), (2000, 2))
    seen = np.hstack([places, np.ones((2000, 1))]) @ homography.T
    others = seen[:, :2] / seen[:, 2:]
    inside = (np.abs(others) < (0.5, 0.375)).all(1) & (seen[:, 2] > 0)
    noises = generator.normal(0, noise, (2, inside.sum(), 2))
    return only_turned(places[inside] + noises[0], others[inside] + noises[1], homography)


@pytest.fixture
def generator() -> np.random.Generator:
    return np.random.default_rng(0)


def test_turns_are_told_at_all_fields_of_view(generator):
    found = [
        only_turns(generator, view, turn_by(degrees, generator.normal((0, 1, 0), (0.3, 0, 0.1))))
        for view in (45, 60, 75, 90)
        for degrees in (5, 10, 20, 30)
        for _ in range(3)
    ]
    assert np.mean(found) > 0.9


@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_steps_along_a_plane_are_no_turns(generator, noise):
    found = []
    for view in (30, 45, 60, 75, 90):
        for shift in (0.1, 0.2, 0.4):
            for tilt in (0.0, 10.0, 30.0):
                for turn in (0.0, 3.0):
                    normal = turn_by(tilt, generator.normal(size=3)) @ [0, 0, 1]
                    step = np.append(generator.normal(size=2), 0.0)
                    step *= 2 * shift * np.tan(np.radians(view) / 2) / np.linalg.norm(step)
                    motion = turn_by(turn, generator.normal(size=3)) + np.outer(step, normal)
                    found.append(only_turns(generator, view, motion, noise))
    assert np.mean(found) < 0.04


def test_a_straight_flight_over_flat_ground_never_turns(generator):
    for view in (20, 45, 70, 100):
        for step in (0.05, 0.2, 0.5):
            motion = np.eye(3) + np.outer([step * np.tan(np.radians(view) / 2), 0, 0], [0, 0, 1])
            assert not only_turns(generator, view, motion)


def test_an_orbit_of_a_wall_is_no_turn(generator):
    for degrees in (5, 15, 30):
        turn = turn_by(degrees, np.array([0, 1, 0]))
        motion = turn + np.outer(np.array([0, 0, 1]) - turn[:, 2], [0, 0, 1])
        assert not only_turns(generator, 60, motion)
