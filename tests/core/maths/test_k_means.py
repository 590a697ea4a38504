"""k-means in groups: near to Lloyd's algorithm, the same on every machine."""

import numpy as np
import pytest
import torch

from gsfw.core.maths import k_means as module
from gsfw.core.maths.k_means import Clusters, k_means


def clustered(count, dims=9, seed=0):
    """Vectors around a few centres, some far out, some equal to 0."""
    random = np.random.default_rng(seed)
    centers = random.standard_normal((40, dims)) * random.exponential(size=(40, 1))
    points = centers[random.integers(40, size=count)] + 0.1 * random.standard_normal((count, dims))
    points[: count // 10] = 0
    return points.astype(np.float32)


def error(points, clusters: Clusters, weights=1.0):
    difference = points - clusters.centroids[clusters.nearest(points)]
    return float((np.square(difference, dtype=np.float64).sum(axis=1) * weights).mean())


def lloyd(points, count, rounds, seed=0):
    """Error of Lloyd's algorithm over all pairs, from random seeds, in float64."""
    points = points.astype(np.float64)
    centers = points[np.random.default_rng(seed).permutation(len(points))[:count]]
    for _ in range(rounds):
        labels = ((points[:, None] - centers) ** 2).sum(axis=2).argmin(axis=1)
        centers = np.stack(
            [
                points[labels == label].mean(axis=0) if (labels == label).any() else centers[label]
                for label in range(count)
            ]
        )
    distances = ((points[:, None] - centers) ** 2).sum(axis=2)
    return float(distances.min(axis=1).mean())


def test_separate_clusters_are_found_and_their_centroids_are_means():
    random = np.random.default_rng(1)
    centers = 10 * np.eye(6, dtype=np.float32)
    member = np.concatenate([np.arange(6), random.integers(6, size=294)])
    points = (centers[member] + 0.01 * random.standard_normal((300, 6))).astype(np.float32)
    clusters = k_means(points, 6)
    labels = clusters.nearest(points)
    for cluster in range(6):
        own = points[member == cluster]
        assert len(set(labels[member == cluster])) == 1
        assert np.allclose(clusters.centroids[labels[cluster]], own.mean(axis=0), atol=1e-6)


@pytest.mark.parametrize("count", [16, 100])
def test_the_error_is_below_that_of_lloyds_algorithm_from_random_seeds(count, monkeypatch):
    monkeypatch.setattr(module, "GROUP", 20)
    points = clustered(1500)
    usual = np.mean([lloyd(points, count, module.ROUNDS, seed) for seed in range(3)])
    assert error(points, k_means(points, count)) < usual


def test_a_vector_for_each_point_leaves_no_error():
    points = clustered(700)
    assert len(k_means(points, 700).centroids) == 700
    assert len(k_means(points, 9999).centroids) == 700
    assert error(points, k_means(points, 700)) < 1e-6


def test_the_nearest_vector_is_found_but_for_a_few(monkeypatch):
    monkeypatch.setattr(module, "GROUP", 8)
    points = clustered(2000)
    clusters = k_means(points, 128)
    distances = torch.cdist(torch.from_numpy(points), torch.from_numpy(clusters.centroids)).numpy()
    found = distances[np.arange(len(points)), clusters.nearest(points)]
    assert (found <= distances.min(axis=1) + 2 * clusters.grid.size).mean() > 0.98


def test_weights_draw_vectors_to_important_points():
    points = np.random.default_rng(3).standard_normal((1000, 4)).astype(np.float32)
    weights = np.where(np.arange(1000) % 2 == 0, 1.0, 0.01)
    equal, weighted = k_means(points, 60), k_means(points, 60, weights)
    assert error(points, weighted, weights) < 0.9 * error(points, equal, weights)


def test_every_sum_is_exact_so_that_the_order_of_additions_changes_nothing(monkeypatch):
    points = clustered(1000, dims=45)
    points[7] *= 1000  # An outlier does not make the grid coarse.
    first = k_means(points, 300)
    cells = first.grid.cells(points)
    assert np.array_equal(cells, np.rint(cells))
    assert np.linalg.norm(cells.astype(np.float64), axis=1).max() <= module.LONGEST
    assert first.grid.size < np.linalg.norm(np.delete(points, 7, axis=0), axis=1).max() / 200
    # Another order of dimensions, and other blocks of pairs: other sums, the same labels.
    monkeypatch.setattr(module, "PAIRS", 5000)
    turned = np.random.default_rng(0).permutation(45)
    second = k_means(np.ascontiguousarray(points[:, turned]), 300)
    assert np.array_equal(first.nearest(points), second.nearest(points[:, turned]))
    assert np.array_equal(first.centroids[:, turned], second.centroids)


def test_the_number_of_threads_changes_no_bit():
    points = clustered(3000)
    before = torch.get_num_threads()
    found = []
    for threads in (1, 3):
        torch.set_num_threads(threads)
        found.append(k_means(points, 600))
        assert torch.get_num_threads() == threads
    torch.set_num_threads(before)
    assert np.array_equal(found[0].centroids, found[1].centroids)


def test_few_small_points_among_zeros_are_told_apart():
    points = np.zeros((5000, 3), dtype=np.float32)
    points[::500] = 1e-4 * np.random.default_rng(0).standard_normal((10, 3))
    clusters = k_means(points, 11)
    assert np.allclose(clusters.centroids[clusters.nearest(points)], points, rtol=1e-3, atol=1e-7)


@pytest.mark.parametrize("value", [0.0, 3.0])
def test_equal_points_are_one_vector(value):
    points = np.full((50, 3), value, dtype=np.float32)
    clusters = k_means(points, 4)
    assert np.array_equal(clusters.centroids[clusters.nearest(points)], points)


def test_points_that_were_not_seen_get_the_nearest_vector():
    points = clustered(1200)
    clusters = k_means(points[::2], 64)
    assert error(points[1::2], clusters) < 2 * error(points[::2], clusters) + 1e-3
