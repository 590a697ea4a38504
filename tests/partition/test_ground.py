import numpy as np

from gsfw.partition.ground import find_ground


def looking_down(places: np.ndarray) -> np.ndarray:
    """World-to-camera poses of cameras that look along -z."""
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :3, :3] = np.diag([1.0, -1.0, -1.0])
    poses[:, :3, 3] = -(poses[:, :3, :3] @ places[:, :, None])[:, :, 0]
    return poses


def scene(origin=(0.0, 0.0, 0.0)):
    generator = np.random.default_rng(0)
    points = generator.uniform(-1, 1, (500, 3)) * np.array([9.0, 4.0, 0.3]) + np.array(origin)
    cameras = generator.uniform(-1, 1, (20, 3)) * np.array([9.0, 4.0, 0.1])
    return points, looking_down(cameras + np.array([0.0, 0.0, 3.0]) + np.array(origin))


def test_up_is_across_the_points_on_the_side_of_the_cameras():
    points, poses = scene()
    ground = find_ground(points, poses, None)
    assert ground.axes[2] @ [0, 0, 1] > 0.999
    assert abs(ground.axes[0] @ [1, 0, 0]) > 0.99
    assert np.allclose(ground.axes @ ground.axes.T, np.eye(3))


def test_a_convention_that_contradicts_the_points_does_not_count():
    points, poses = scene()
    ground = find_ground(points, poses, np.array([0.0, -1.0, 0.0]))
    assert ground.axes[2] @ [0, 0, 1] > 0.999


def test_without_a_plane_up_is_as_stated_or_as_cameras_are_held():
    points = np.random.default_rng(0).normal(size=(500, 3))
    poses = np.tile(np.eye(4), (4, 1, 1))  # y downwards.
    assert find_ground(points, poses, np.array([0.0, 0.0, 1.0])).axes[2] @ [0, 0, 1] > 0.999
    assert find_ground(points, poses, None).axes[2] @ [0, -1, 0] > 0.999


def test_places_far_from_the_origin_keep_their_digits():
    points, poses = scene()
    far, far_poses = scene((5e6, -3e6, 100.0))
    near_places = find_ground(points, poses, None).places(points)
    far_places = find_ground(far, far_poses, None).places(far)
    signs = np.sign((near_places * far_places).sum(0))
    assert np.abs(near_places - signs * far_places).max() < 1e-6


def test_a_place_does_not_depend_on_the_others():
    points, poses = scene()
    ground = find_ground(points, poses, None)
    assert np.array_equal(ground.places(points[7:8])[0], ground.places(points)[7])
